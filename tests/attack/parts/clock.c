// Sets CLOCK_REALTIME by STEP_S once AFTER_S have gone by, and by STEP2_S after as much again.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <time.h>

static double number(const char *name) { const char *v = getenv(name); return v ? atof(v) : 0.0; }

int clock_gettime(clockid_t id, struct timespec *t) {
  static int (*real)(clockid_t, struct timespec *);
  static double began;
  if (!real) real = dlsym(RTLD_NEXT, "clock_gettime");
  struct timespec m;
  real(CLOCK_MONOTONIC, &m);
  double now = m.tv_sec + 1e-9 * m.tv_nsec;
  if (began == 0) began = now;
  int r = real(id, t);
  if (id == CLOCK_REALTIME) {
    double by = (now - began > number("AFTER_S") ? number("STEP_S") : 0.0) + (now - began > 2 * number("AFTER_S") ? number("STEP2_S") : 0.0);
    long ns = t->tv_nsec + (long)((by - (double)(long)by) * 1e9);
    t->tv_sec += (long)by;
    while (ns < 0) { ns += 1000000000L; t->tv_sec -= 1; }
    while (ns >= 1000000000L) { ns -= 1000000000L; t->tv_sec += 1; }
    t->tv_nsec = ns;
  }
  return r;
}
