#include "service/sandbox/confinement.h"

#include <linux/landlock.h>
#include <sched.h>
#include <seccomp.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <fstream>
#include <system_error>

namespace fogbank::service {
namespace {

/// Bytes of address space that the process has: libraries, mostly.
[[maybe_unused]] uint64_t address_space() {
  uint64_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  return pages * static_cast<uint64_t>(::sysconf(_SC_PAGESIZE));
}

/// 0, or errno of a limit that is not in force. One that was tighter before stays, and is.
int limit(__rlimit_resource resource, rlim_t soft, rlim_t hard) {
  const rlimit both{.rlim_cur = soft, .rlim_max = hard};
  if (::setrlimit(resource, &both) == 0) return 0;
  const int error = errno;
  rlimit before{};
  return ::getrlimit(resource, &before) == 0 && before.rlim_cur <= soft ? 0 : error;
}
int limit(__rlimit_resource resource, rlim_t value) { return limit(resource, value, value); }

/// As all layers here: 0, or errno.
int limit_resources() {
  // The first to go when the machine, or the container, runs out of memory.
  std::ofstream("/proc/self/oom_score_adj") << 1000;
  int error = 0;
  const auto note = [&error](int result) {
    if (error == 0) error = result;
  };
#if !defined(__SANITIZE_ADDRESS__) && !defined(FOGBANK_ADDRESS_SANITIZER)  // whose shadow takes terabytes
  note(limit(RLIMIT_AS, address_space() + ReaderLimits::memory_bytes));
#endif
  // At the soft limit the kernel says why it ends the process.
  note(limit(RLIMIT_CPU, ReaderLimits::cpu_seconds, ReaderLimits::cpu_seconds + 10));
  note(limit(RLIMIT_FSIZE, 0));
  note(limit(RLIMIT_CORE, 0));
  note(limit(RLIMIT_NOFILE, 16));
  return error;
}

/// A ruleset without rules: every access to a path that it handles is denied.
int forbid_paths() {
  landlock_ruleset_attr all{};
  all.handled_access_fs = (uint64_t{LANDLOCK_ACCESS_FS_MAKE_SYM} << 1) - 1;
  const auto ruleset =
      static_cast<int>(::syscall(SYS_landlock_create_ruleset, &all, sizeof all.handled_access_fs, 0));
  if (ruleset < 0) return errno;
  const int error = ::syscall(SYS_landlock_restrict_self, ruleset, 0) == 0 ? 0 : errno;
  ::close(ruleset);
  return error;
}

/// What readers call. Everything else fails with EPERM, which libraries cope with, but for calls that only an
/// intruder makes: those end the process.
constexpr int allowed[] = {SCMP_SYS(read),
                           SCMP_SYS(pread64),
                           SCMP_SYS(write),
                           SCMP_SYS(lseek),
                           SCMP_SYS(close),
                           SCMP_SYS(sendto),
                           SCMP_SYS(recvfrom),
                           SCMP_SYS(recvmsg),
                           SCMP_SYS(munmap),
                           SCMP_SYS(mremap),
                           SCMP_SYS(brk),
                           SCMP_SYS(madvise),
                           SCMP_SYS(futex),
                           SCMP_SYS(exit),
                           SCMP_SYS(exit_group),
                           SCMP_SYS(rt_sigreturn),
                           SCMP_SYS(rt_sigaction),
                           SCMP_SYS(rt_sigprocmask),
                           SCMP_SYS(clock_gettime),
                           SCMP_SYS(clock_nanosleep),
                           SCMP_SYS(gettimeofday),
                           SCMP_SYS(getrandom),
                           SCMP_SYS(getpid),
                           SCMP_SYS(gettid),
                           SCMP_SYS(set_robust_list),
                           SCMP_SYS(rseq),
                           SCMP_SYS(sched_yield),
                           SCMP_SYS(sched_getaffinity),
                           SCMP_SYS(restart_syscall)};
constexpr int deadly[] = {SCMP_SYS(socket),
                          SCMP_SYS(connect),
                          SCMP_SYS(bind),
                          SCMP_SYS(listen),
                          SCMP_SYS(accept),
                          SCMP_SYS(accept4),
                          SCMP_SYS(execve),
                          SCMP_SYS(execveat),
                          SCMP_SYS(fork),
                          SCMP_SYS(vfork),
                          SCMP_SYS(ptrace),
                          SCMP_SYS(kill),
                          SCMP_SYS(tkill),
                          SCMP_SYS(bpf),
                          SCMP_SYS(io_uring_setup),
                          SCMP_SYS(process_vm_readv),
                          SCMP_SYS(process_vm_writev),
                          SCMP_SYS(unshare),
                          SCMP_SYS(mount),
                          SCMP_SYS(keyctl),
                          SCMP_SYS(perf_event_open)};

/// 0, or what libseccomp says: the negative of an errno.
int add_rules(scmp_filter_ctx filter) {
  for (const int call : allowed)
    if (const int error = seccomp_rule_add(filter, SCMP_ACT_ALLOW, call, 0)) return error;
  for (const int call : deadly)
    if (const int error = seccomp_rule_add(filter, SCMP_ACT_KILL_PROCESS, call, 0)) return error;
  // Memory, but none that can be run.
  for (const int call : {SCMP_SYS(mmap), SCMP_SYS(mprotect)})
    if (const int error =
            seccomp_rule_add(filter, SCMP_ACT_ALLOW, call, 1, SCMP_A2(SCMP_CMP_MASKED_EQ, PROT_EXEC, 0)))
      return error;
  // OpenImageIO keeps a thread whatever it is told. Flags of clone3 can't be looked at; without it, clone is
  // called.
  if (const int error = seccomp_rule_add(filter, SCMP_ACT_ERRNO(ENOSYS), SCMP_SYS(clone3), 0)) return error;
  if (const int error = seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(clone), 1,
                                         SCMP_A0(SCMP_CMP_MASKED_EQ, CLONE_THREAD, CLONE_THREAD)))
    return error;
  // abort() signals its own thread.
  return seccomp_rule_add(filter, SCMP_ACT_ALLOW, SCMP_SYS(tgkill), 1,
                          SCMP_A0(SCMP_CMP_EQ, static_cast<scmp_datum_t>(::getpid()), 0));
}

int filter_system_calls() {
  const scmp_filter_ctx filter = seccomp_init(SCMP_ACT_ERRNO(EPERM));
  if (filter == nullptr) return ENOMEM;
  int error = add_rules(filter);
  if (error == 0) error = seccomp_load(filter);
  seccomp_release(filter);
  return -error;
}

}  // namespace

Confinement confine_this_process() {
  Confinement confinement;
  confinement.limits_error = limit_resources();
  ::prctl(PR_SET_DUMPABLE, 0);
  ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  confinement.landlock_error = forbid_paths();
  confinement.seccomp_error = filter_system_calls();
  return confinement;
}

std::array<ConfinementLayer, 3> layers_of(const Confinement& confinement) {
  const auto layer = [](const char* name, int32_t error) {
    return ConfinementLayer{.name = name,
                            .problem = error == 0 ? "" : std::generic_category().message(error)};
  };
  return {layer("rlimits", confinement.limits_error), layer("seccomp", confinement.seccomp_error),
          layer("landlock", confinement.landlock_error)};
}

}  // namespace fogbank::service
