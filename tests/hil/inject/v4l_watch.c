// v4l_watch DEV FOURCC WIDTH HEIGHT SECONDS : a small reader that says what the driver hands out, buffer by buffer.
// It proves the fault injectors without the daemon. Lines: "frame SEQ flags BYTES STAMP_AGE_MS [HILnnn]", "silent",
// "errno CALL NAME", "reopened". After ENODEV it waits for the node, after EIO/EPIPE-like ends it restarts streaming.
#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

enum { BUFFERS = 4 };
static double now_s(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t); return t.tv_sec + t.tv_nsec * 1e-9; }
static int failed(const char *call) { printf("%.3f errno %s %s\n", now_s(), call, strerror(errno)); return -1; }
static struct { void *start; size_t length; } map[BUFFERS];

static int start(const char *dev, const char *fourcc, int width, int height) {
  int fd = open(dev, O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) return -1;
  struct v4l2_format f = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};
  if (ioctl(fd, VIDIOC_G_FMT, &f)) { failed("G_FMT"); close(fd); return -1; }
  f.fmt.pix.width = width; f.fmt.pix.height = height; f.fmt.pix.bytesperline = 0; f.fmt.pix.sizeimage = 0;
  f.fmt.pix.field = V4L2_FIELD_ANY;
  f.fmt.pix.pixelformat = v4l2_fourcc(fourcc[0], fourcc[1], fourcc[2], fourcc[3]);
  struct v4l2_requestbuffers r = {.count = BUFFERS, .type = f.type, .memory = V4L2_MEMORY_MMAP};
  if (ioctl(fd, VIDIOC_S_FMT, &f)) { failed("S_FMT"); close(fd); return -1; }
  printf("%.3f format %.4s %ux%u stride %u size %u\n", now_s(), (char *)&f.fmt.pix.pixelformat, f.fmt.pix.width, f.fmt.pix.height, f.fmt.pix.bytesperline, f.fmt.pix.sizeimage);
  if (ioctl(fd, VIDIOC_REQBUFS, &r)) { failed("REQBUFS"); close(fd); return -1; }
  for (unsigned i = 0; i < r.count && i < BUFFERS; i++) {
    struct v4l2_buffer b = {.type = f.type, .memory = V4L2_MEMORY_MMAP, .index = i};
    if (ioctl(fd, VIDIOC_QUERYBUF, &b)) { failed("QUERYBUF"); close(fd); return -1; }
    map[i].length = b.length;
    map[i].start = mmap(0, b.length, PROT_READ | PROT_WRITE, MAP_SHARED, fd, b.m.offset);
    if (map[i].start == MAP_FAILED || ioctl(fd, VIDIOC_QBUF, &b)) { failed("QBUF"); close(fd); return -1; }
  }
  int type = f.type;
  if (ioctl(fd, VIDIOC_STREAMON, &type)) { failed("STREAMON"); close(fd); return -1; }
  return fd;
}
static void stop(int fd) {
  for (int i = 0; i < BUFFERS; i++) if (map[i].start) { munmap(map[i].start, map[i].length); map[i].start = 0; }
  close(fd);
}
int main(int argc, char **argv) {
  if (argc != 6) { fprintf(stderr, "v4l_watch DEV FOURCC WIDTH HEIGHT SECONDS\n"); return 2; }
  setvbuf(stdout, 0, _IOLBF, 0);
  double end = now_s() + atof(argv[5]); long frames = 0;
  int fd = -1, was_open = 0, silent = 0;
  while (now_s() < end) {
    if (fd < 0) {
      if ((fd = start(argv[1], argv[2], atoi(argv[3]), atoi(argv[4]))) < 0) { struct timespec w = {0, 100000000}; nanosleep(&w, 0); continue; }
      if (was_open) printf("%.3f reopened\n", now_s());
      was_open = 1;
    }
    struct pollfd p = {fd, POLLIN, 0};
    if (poll(&p, 1, 500) == 0) {
      printf("%.3f silent\n", now_s());
      if (++silent == 3) { printf("%.3f restart after silence\n", now_s()); stop(fd); fd = -1; silent = 0; }
      continue;
    }
    struct v4l2_buffer b = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP};
    if (ioctl(fd, VIDIOC_DQBUF, &b)) {
      if (errno == EAGAIN) continue;
      failed("DQBUF"); stop(fd); fd = -1;
      struct timespec w = {0, 100000000}; nanosleep(&w, 0);
      continue;
    }
    silent = 0; frames++;
    const char *m = map[b.index].start;
    char id[16] = "";
    if (b.bytesused > 20 && !memcmp(m + 2, "\xff\xfe\x00\x0d", 4)) memcpy(id, m + 6, 11);
    double stamp = b.timestamp.tv_sec + b.timestamp.tv_usec * 1e-6;
    printf("%.3f frame %u %#x %u %.1f %s\n", now_s(), b.sequence, b.flags, b.bytesused, (now_s() - stamp) * 1e3, id);
    if (ioctl(fd, VIDIOC_QBUF, &b)) failed("QBUF");
  }
  printf("%.3f total %ld\n", now_s(), frames);
  return 0;
}
