// measured FILE COMMAND...: runs a command and writes its peak memory [kB] into FILE; ends as the command did.
//
// wait4 says of a child the most that it took since its parent forked it: exec keeps the figure. So the parent has to be small,
// which Python is not.
#define _GNU_SOURCE
#include <signal.h>
#include <stdio.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

static volatile pid_t child;
static void pass_on(int which) { kill(child, which); }

int main(int n, char **words) {
  const int passed[] = {SIGTERM, SIGINT, SIGHUP, SIGQUIT};
  sigset_t all, before;
  if (n < 3) return 2;
  sigfillset(&all);
  sigprocmask(SIG_SETMASK, &all, &before);
  child = fork();
  if (child == 0) {
    // Whoever kills this one means the command.
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    sigprocmask(SIG_SETMASK, &before, NULL);
    execvp(words[2], words + 2);
    _exit(127);
  }
  if (child < 0) return 2;
  for (unsigned k = 0; k < sizeof passed / sizeof *passed; k++) signal(passed[k], pass_on);
  sigprocmask(SIG_SETMASK, &before, NULL);
  int status = 0;
  struct rusage usage;
  while (wait4(child, &status, 0, &usage) < 0) {}
  FILE *out = fopen(words[1], "w");
  if (!out) return 2;
  fprintf(out, "%ld\n", usage.ru_maxrss);
  fclose(out);
  if (WIFSIGNALED(status)) {
    // No second core of the same death.
    const struct rlimit none = {0, 0};
    setrlimit(RLIMIT_CORE, &none);
    signal(WTERMSIG(status), SIG_DFL);
    raise(WTERMSIG(status));
  }
  return WEXITSTATUS(status);
}
