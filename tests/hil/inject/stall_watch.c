// stall_watch FILE : appends "UPTIME_S CPU LATE_MS" whenever a processor of the guest stood still for over 20 ms.
// One process per processor, pinned, before everything else there (SCHED_FIFO 99), asleep for 10 ms at a time: who wakes
// such a process late is the host or the kernel, not the daemon (init takes the throttle off real-time threads). Lines are written when they happen.
#define _GNU_SOURCE
#include <fcntl.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

enum { PERIOD_NS = 10000000, LATE_NS = 20000000 };

static long long now_ns(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * 1000000000LL + t.tv_nsec;
}

static void watch(int cpu, int out) {
  cpu_set_t mine;
  CPU_ZERO(&mine);
  CPU_SET(cpu, &mine);
  struct sched_param first = {.sched_priority = 99};
  if (sched_setaffinity(0, sizeof mine, &mine) || sched_setscheduler(0, SCHED_FIFO, &first) || mlockall(MCL_CURRENT)) {
    perror("stall_watch");
    exit(1);
  }
  for (long long due = now_ns() + PERIOD_NS;; due = now_ns() + PERIOD_NS) {
    struct timespec t = {due / 1000000000LL, due % 1000000000LL};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
    long long late = now_ns() - due;
    if (late > LATE_NS) dprintf(out, "%.3f %d %.1f\n", now_ns() * 1e-9, cpu, late * 1e-6);
  }
}

int main(int argc, char **argv) {
  int out = argc == 2 ? open(argv[1], O_WRONLY | O_CREAT | O_APPEND, 0644) : -1;
  if (out < 0) {
    fprintf(stderr, "stall_watch FILE\n");
    return 2;
  }
  long cpus = sysconf(_SC_NPROCESSORS_ONLN);
  for (int cpu = 1; cpu < cpus; cpu++)
    if (fork() == 0) watch(cpu, out);
  watch(0, out);
}
