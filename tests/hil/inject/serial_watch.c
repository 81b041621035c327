// serial_watch PORT SECONDS : writes a 16-byte line every 50 ms and expects it back (the host end echoes); says when the
// port goes and comes back. It proves the serial fault injection without the daemon.
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

static double now_s(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t); return t.tv_sec + t.tv_nsec * 1e-9; }
int main(int argc, char **argv) {
  if (argc != 3) { fprintf(stderr, "serial_watch PORT SECONDS\n"); return 2; }
  setvbuf(stdout, 0, _IOLBF, 0);
  double end = now_s() + atof(argv[2]); int fd = -1; long sent = 0, back = 0, mute = 0;
  while (now_s() < end) {
    struct timespec w = {0, 50000000};
    if (fd < 0) {
      if ((fd = open(argv[1], O_RDWR | O_NOCTTY | O_NONBLOCK)) < 0) { nanosleep(&w, 0); continue; }
      struct termios t; tcgetattr(fd, &t); cfmakeraw(&t); cfsetspeed(&t, B115200); tcsetattr(fd, TCSANOW, &t);
      printf("%.3f open\n", now_s());
    }
    char b[64]; snprintf(b, sizeof b, "ping%011ld\n", sent);
    if (write(fd, b, 16) != 16) { printf("%.3f lost write %s\n", now_s(), strerror(errno)); close(fd); fd = -1; continue; }
    sent++;
    struct pollfd p = {fd, POLLIN, 0}; int got = 0, gone = 0;
    while (got < 16 && poll(&p, 1, 200) > 0) {
      ssize_t n = read(fd, b + got, 16 - got);
      if (n <= 0) { gone = 1; break; }
      got += n;
    }
    if (gone) { printf("%.3f lost read %s\n", now_s(), strerror(errno)); close(fd); fd = -1; }
    else if (got == 16) { if (mute) printf("%.3f answers again\n", now_s()); mute = 0; back++; }
    else if (!mute) { mute = 1; printf("%.3f no answer\n", now_s()); }
    nanosleep(&w, 0);
  }
  printf("%.3f total sent %ld back %ld\n", now_s(), sent, back);
  return 0;
}
