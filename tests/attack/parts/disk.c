// A bad disk for files whose name holds `run.mcap`: DISK_FAULT says which, from DISK_AFTER bytes on, DISK_STALL_S how long a
// stall is. A fault that came makes the file DISK_MARK.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <time.h>
#include <unistd.h>

static const char *fault(void) { const char *f = getenv("DISK_FAULT"); return f ? f : ""; }
static long after(void) { const char *a = getenv("DISK_AFTER"); return a ? atol(a) : 0; }

static int ours(int fd) {
  char link[64], name[4096];
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  ssize_t n = readlink(link, name, sizeof name - 1);
  if (n < 0) return 0;
  name[n] = 0;
  return strstr(name, "run.mcap") != NULL;
}

static void came(void) {
  const char *mark = getenv("DISK_MARK");
  if (mark) { FILE *f = fopen(mark, "w"); if (f) fclose(f); }
}

static double stall_s(void) { const char *s = getenv("DISK_STALL_S"); return s ? atof(s) : 2.0; }

static void nap(double s) {
  struct timespec t = {(time_t)s, (long)((s - (time_t)s) * 1e9)};
  nanosleep(&t, NULL);
}

static ssize_t judged(int fd, const void *data, size_t n, off_t at, ssize_t (*plain)(int, const void *, size_t, off_t)) {
  static _Thread_local int turns;
  static long written, stalled, failed;
  if (!ours(fd)) return plain(fd, data, n, at);
  const char *f = fault();
  if (written >= after() && *f && strncmp(f, "sync", 4) != 0) {
    came();
    if (!strcmp(f, "eio")) { errno = EIO; return -1; }
    if (!strcmp(f, "enospc")) { errno = ENOSPC; return -1; }
    if (!strcmp(f, "edquot")) { errno = EDQUOT; return -1; }
    if (!strcmp(f, "erofs")) { errno = EROFS; return -1; }
    if (!strcmp(f, "eio-once") && !failed) { failed = 1; errno = EIO; return -1; }
    if (!strcmp(f, "enospc-once") && !failed) { failed = 1; errno = ENOSPC; return -1; }
    if (!strcmp(f, "half") && n > 1) n /= 2;
    if (!strcmp(f, "one") && n > 4096) n = 1 + n % 4096;
    if (!strcmp(f, "eintr") && turns++ % 3 == 0) { errno = EINTR; return -1; }
    if (!strcmp(f, "stall") && !stalled) { stalled = 1; nap(stall_s()); }
    if (!strcmp(f, "zero") && !failed) { failed = 1; return 0; }
  }
  ssize_t done = plain(fd, data, n, at);
  if (done > 0) written += done;
  return done;
}

static ssize_t plain_write(int fd, const void *data, size_t n, off_t at) {
  static ssize_t (*real)(int, const void *, size_t);
  (void)at;
  if (!real) real = dlsym(RTLD_NEXT, "write");
  return real(fd, data, n);
}
static ssize_t plain_pwrite(int fd, const void *data, size_t n, off_t at) {
  static ssize_t (*real)(int, const void *, size_t, off_t);
  if (!real) real = dlsym(RTLD_NEXT, "pwrite64");
  return real(fd, data, n, at);
}
ssize_t write(int fd, const void *data, size_t n) { return judged(fd, data, n, 0, plain_write); }
ssize_t pwrite64(int fd, const void *data, size_t n, off_t at) { return judged(fd, data, n, at, plain_pwrite); }
ssize_t pwrite(int fd, const void *data, size_t n, off_t at) { return judged(fd, data, n, at, plain_pwrite); }

static int synced(int fd, const char *name) {
  int (*real)(int) = dlsym(RTLD_NEXT, name);
  if (ours(fd) && strncmp(fault(), "sync", 4) == 0) {
    came();
    if (!strcmp(fault(), "sync-eio")) { errno = EIO; return -1; }
    if (!strcmp(fault(), "sync-stall")) nap(1.0);
  }
  return real(fd);
}
int fsync(int fd) { return synced(fd, "fsync"); }
int fdatasync(int fd) { return synced(fd, "fdatasync"); }
