#include "core/failpoint.h"

#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <map>
#include <string>
#include <string_view>
#include <thread>

#include "core/files.h"

namespace fogbank {

namespace {

struct Failpoint {
  std::string action;
  std::string argument;
  int only_at = 0;  ///< 0: each time
  std::atomic<int> reached = 0;
};

using Failpoints = std::map<std::string, Failpoint, std::less<>>;

/// The text before `separator`, which is taken from the front with it.
std::string take(std::string_view& text, char separator) {
  const size_t end = text.find(separator);
  std::string taken(text.substr(0, end));
  text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  return taken;
}

Failpoints read_environment() {
  Failpoints failpoints;
  const char* const value = std::getenv("FOGBANK_FAILPOINTS");
  std::string_view rest = value == nullptr ? "" : value;
  while (!rest.empty()) {
    const std::string one = take(rest, ',');
    std::string_view text = one;
    Failpoint& failpoint = failpoints[take(text, '=')];
    const std::string what = take(text, '@');
    if (!text.empty()) failpoint.only_at = std::stoi(std::string(text));
    text = what;
    failpoint.action = take(text, ':');
    failpoint.argument = text;
  }
  return failpoints;
}

}  // namespace

void reach_failpoint(const char* name) {
  static Failpoints failpoints = read_environment();
  const auto found = failpoints.find(std::string_view(name));
  if (found == failpoints.end()) return;
  Failpoint& failpoint = found->second;
  const int count = ++failpoint.reached;
  if (failpoint.only_at != 0 && failpoint.only_at != count) return;
  const std::string line = std::string("failpoint ") + name + ": " + failpoint.action + "\n";
  [[maybe_unused]] const ssize_t written = ::write(STDERR_FILENO, line.data(), line.size());
  if (failpoint.action == "panic") ::kill(::getpid(), SIGKILL);
  if (failpoint.action == "delay")
    std::this_thread::sleep_for(std::chrono::milliseconds(std::stoi(failpoint.argument)));
  if (failpoint.action == "error")
    throw_file_error(failpoint.argument == "ENOSPC" ? ENOSPC : EIO, "reaching the failpoint", name);
}

}  // namespace fogbank
