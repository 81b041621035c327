// loopback_feed DEV WIDTH HEIGHT FPS FRAMES LOG : feeds GREY frames to v4l2loopback by write(), paced on CLOCK_MONOTONIC.
//
// Idle (black) frames until a 'g' arrives on the FIFO /tmp/feed, then every frame of the file FRAMES (raw, one after the
// other) exactly once, then idle frames again until 'q'. So a recorder can start and stop without a frame lost to
// v4l2loopback's habit of handing a stale buffer to a reader that has just started.
// LOG gets: CLOCK_MONOTONIC [s], word, number.
#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

static FILE *truth;
static void note(const char *word, long number) {
  struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t);
  fprintf(truth, "%ld.%06ld %s %ld\n", (long)t.tv_sec, t.tv_nsec / 1000, word, number); fflush(truth);
}
int main(int argc, char **argv) {
  if (argc != 7) { fprintf(stderr, "loopback_feed DEV WIDTH HEIGHT FPS FRAMES LOG\n"); return 2; }
  unsigned width = atoi(argv[2]), height = atoi(argv[3]); double fps = atof(argv[4]);
  size_t size = (size_t)width * height;
  if (!(truth = fopen(argv[6], "a"))) { perror(argv[6]); return 2; }
  FILE *in = fopen(argv[5], "rb");
  if (!in || !size || !(fps > 0)) { perror(argv[5]); return 2; }
  fseek(in, 0, SEEK_END); long count = ftell(in) / (long)size; rewind(in);
  unsigned char *frames = malloc(size * (count + 1));
  if (!frames || fread(frames, size, count, in) != (size_t)count) { fprintf(stderr, "cannot read %ld frames\n", count); return 2; }
  unsigned char *idle = frames + size * count; memset(idle, 0, size);
  int fd = open(argv[1], O_RDWR); if (fd < 0) { perror(argv[1]); return 1; }
  struct v4l2_format f = {.type = V4L2_BUF_TYPE_VIDEO_OUTPUT};
  f.fmt.pix.width = width; f.fmt.pix.height = height; f.fmt.pix.pixelformat = V4L2_PIX_FMT_GREY;
  f.fmt.pix.field = V4L2_FIELD_NONE; f.fmt.pix.bytesperline = width; f.fmt.pix.sizeimage = size;
  if (ioctl(fd, VIDIOC_S_FMT, &f)) { perror("VIDIOC_S_FMT"); return 1; }
  struct v4l2_streamparm p = {.type = V4L2_BUF_TYPE_VIDEO_OUTPUT};
  p.parm.output.timeperframe.numerator = 1000; p.parm.output.timeperframe.denominator = (unsigned)(fps * 1000);
  if (ioctl(fd, VIDIOC_S_PARM, &p)) perror("VIDIOC_S_PARM");
  mkfifo("/tmp/feed", 0600);
  int control = open("/tmp/feed", O_RDWR | O_NONBLOCK);
  if (control < 0) { perror("/tmp/feed"); return 1; }
  note("ready", count);
  struct timespec due; clock_gettime(CLOCK_MONOTONIC, &due);
  for (long next = -1, running = 1; running;) {
    char k;
    while (read(control, &k, 1) == 1) { if (k == 'g' && next < 0) { next = 0; note("go", 0); } if (k == 'q') running = 0; }
    const unsigned char *b = next >= 0 && next < count ? frames + size * next : idle;
    ssize_t n = write(fd, b, size);
    if (n != (ssize_t)size) note("short_write", errno);
    if (b != idle) { next++; if (next == count) note("fed", count); }
    due.tv_nsec += (long)(1e9 / fps);
    while (due.tv_nsec >= 1000000000) { due.tv_nsec -= 1000000000; due.tv_sec++; }
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, 0);
  }
  note("quit", 0);
  return 0;
}
