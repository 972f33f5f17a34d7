#include "service/sandbox/reader_host.h"

#include <fcntl.h>
#include <linux/close_range.h>
#include <poll.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/signalfd.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <vector>

#include "core/error.h"

namespace fogbank::service {
namespace {

/// Where the host finds its end of the control socket, and a reader its socket: everything above is closed.
constexpr int first_descriptor = 3;

/// A child as the host knows it.
struct Reader {
  pid_t process = -1;
  Socket status;
};

void keep_only(int descriptor) {
  if (descriptor != first_descriptor) ::dup3(descriptor, first_descriptor, 0);
  ::close_range(first_descriptor + 1, ~0U, 0);
}

/// Standard streams go nowhere: libraries print what is in files, and logs are not for files to write.
void silence() {
  const int nowhere = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) ::dup2(nowhere, stream);
  ::close(nowhere);
}

void reset_signals() {
  for (const int signal : {SIGTERM, SIGINT, SIGPIPE, SIGCHLD, SIGHUP}) std::signal(signal, SIG_DFL);
  sigset_t none;
  sigemptyset(&none);
  ::sigprocmask(SIG_SETMASK, &none, nullptr);
}

/// Never comes back to whom the process was forked from; what is thrown ends it.
[[noreturn]] void run_reader(const Socket& data, pid_t host, const ReaderHost::Work& work) noexcept {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != host) ::_exit(1);  // it has ended before the line above
  ::prctl(PR_SET_NAME, "scene-reader");
  keep_only(data.get());
  reset_signals();
  const Socket socket{FileDescriptor(first_descriptor)};
  socket.send_value(confine_this_process());
  work(socket);
  ::_exit(0);
}

class Host {
 public:
  Host(Socket control, const ReaderHost::Work& work) : control_(std::move(control)), work_(work) {
    ::prctl(PR_SET_NAME, "reader-host");
    silence();
    // Ctrl-C in a terminal reaches the whole group; the host ends when the server has.
    for (const int signal : {SIGTERM, SIGINT, SIGHUP}) std::signal(signal, SIG_IGN);
    std::signal(SIGPIPE, SIG_IGN);
    sigset_t children;
    sigemptyset(&children);
    sigaddset(&children, SIGCHLD);
    ::sigprocmask(SIG_SETMASK, &children, nullptr);
    children_ = FileDescriptor(::signalfd(-1, &children, SFD_CLOEXEC | SFD_NONBLOCK));
  }

  /// Returns when the server has closed its end.
  void run() {
    try {
      while (true) {
        std::vector<pollfd> waits = {{.fd = control_.get(), .events = POLLIN, .revents = 0},
                                     {.fd = children_.get(), .events = POLLIN, .revents = 0}};
        for (const Reader& reader : readers_)
          waits.push_back({.fd = reader.status.get(), .events = 0, .revents = 0});
        if (::poll(waits.data(), waits.size(), -1) < 0) continue;
        // The server has given up on those.
        for (size_t i = 0; i < readers_.size(); ++i) {
          if (waits[i + 2].revents == 0) continue;
          ::kill(readers_[i].process, SIGKILL);
          readers_[i].status.close();
        }
        if (waits[1].revents != 0) reap();
        if (waits[0].revents != 0) start_reader();
      }
    } catch (const SocketClosed&) {
      for (const Reader& reader : readers_) ::kill(reader.process, SIGKILL);
    }
  }

 private:
  void start_reader() {
    control_.receive_value<uint8_t>();
    const Socket data(control_.receive_file());
    Reader reader{.process = -1, .status = Socket(control_.receive_file())};
    const pid_t host = ::getpid();
    reader.process = ::fork();
    if (reader.process == 0) run_reader(data, host, work_);
    if (reader.process > 0) readers_.push_back(std::move(reader));
  }

  void reap() {
    signalfd_siginfo ignored;
    while (::read(children_.get(), &ignored, sizeof ignored) > 0) {
    }
    int status = 0;
    for (pid_t process = 0; (process = ::waitpid(-1, &status, WNOHANG)) > 0;) {
      std::erase_if(readers_, [&](const Reader& reader) {
        if (reader.process != process) return false;
        try {
          reader.status.send_value(status);
        } catch (const SocketClosed&) {  // nobody wants to know
        }
        return true;
      });
    }
  }

  Socket control_;
  const ReaderHost::Work& work_;
  FileDescriptor children_;
  std::vector<Reader> readers_;
};

int run_host(int control, const ReaderHost::Work& work) noexcept {
  keep_only(control);
  Host(Socket(FileDescriptor(first_descriptor)), work).run();
  return 0;
}

[[noreturn]] void no_reader(const std::string& why) {
  throw Error(ErrorKind::internal, "NO_SCENE_READER", "no process to read the scene's files: " + why);
}

}  // namespace

std::optional<int> ReaderProcess::wait_status() const {
  constexpr int patience_milliseconds = 5000;
  pollfd wait{.fd = status.get(), .events = POLLIN, .revents = 0};
  if (::poll(&wait, 1, patience_milliseconds) <= 0) return std::nullopt;
  try {
    return status.receive_value<int>();
  } catch (const SocketClosed&) {
    return std::nullopt;
  }
}

ReaderHost::ReaderHost(const Work& work) {
  auto [ours, theirs] = Socket::make_pair();
  const pid_t host = ::fork();
  if (host < 0) no_reader("fork failed");
  if (host == 0) ::_exit(run_host(theirs.get(), work));
  control_ = std::move(ours);
  process_ = host;
}

ReaderHost::~ReaderHost() {
  control_.close();
  if (process_ > 0) ::waitpid(process_, nullptr, 0);
}

std::optional<Confinement> ReaderHost::confinement() const {
  const std::lock_guard lock(confinement_mutex_);
  return confinement_;
}

int ReaderHost::run_as_host(const Work& work) { return run_host(first_descriptor, work); }

void ReaderHost::start_program() {
  control_.close();
  if (process_ > 0) ::waitpid(process_, nullptr, 0);
  process_ = -1;
  auto [ours, theirs] = Socket::make_pair();
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, theirs.get(), first_descriptor);
  std::string program = "/proc/self/exe";
  std::string option = argument;
  char* const arguments[] = {program.data(), option.data(), nullptr};
  pid_t host = -1;
  const int error = ::posix_spawn(&host, program.c_str(), &actions, nullptr, arguments, environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) no_reader("the program can't be started again");
  control_ = std::move(ours);
  process_ = host;
}

ReaderProcess ReaderHost::start_reader() {
  const std::lock_guard lock(mutex_);
  for (const bool again : {false, true}) {
    auto [data, their_data] = Socket::make_pair();
    auto [status, their_status] = Socket::make_pair();
    ReaderProcess reader{.data = std::move(data), .status = std::move(status), .confinement = {}};
    try {
      if (again) start_program();
      control_.send_value(uint8_t{1});
      control_.send_file(their_data.get());
      control_.send_file(their_status.get());
      their_data.close();
      their_status.close();
      reader.confinement = reader.data.receive_value<Confinement>();
      const std::lock_guard known(confinement_mutex_);
      confinement_ = reader.confinement;
      return reader;
    } catch (const SocketClosed&) {  // the host was killed
    }
  }
  no_reader("it ends as soon as it has started");
}

}  // namespace fogbank::service
