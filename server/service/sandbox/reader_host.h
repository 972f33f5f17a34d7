// Where reading processes come from. A process with threads can't fork soundly, and starting the program anew
// costs half a second of loading libraries for each scene. So, before it has threads, the server forks a
// host, which does nothing but fork a reading process for each scene.
#pragma once

#include <sys/types.h>

#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "service/sandbox/confinement.h"
#include "service/sandbox/socket.h"

namespace fogbank::service {

/// A reading process as the server sees it. It ends, at whatever it is, when this is destroyed.
struct ReaderProcess {
  Socket data;
  Socket status;  ///< says how it ended (`wait_status`)
  Confinement confinement;

  /// What waitpid() said of it; nothing where the host has ended, too, or nothing is heard of it for seconds.
  std::optional<int> wait_status() const;
};

class ReaderHost {
 public:
  using Work = std::function<void(const Socket&)>;

  /// Forks the host, whose readers do `work`. To be called before the process has a second thread.
  explicit ReaderHost(const Work& work);
  /// Ends the host and all readers.
  ~ReaderHost();
  ReaderHost(const ReaderHost&) = delete;
  ReaderHost& operator=(const ReaderHost&) = delete;

  /// A new reading process, confined. If the host has been killed, another takes its place: the program
  /// itself, started anew with `argument`. Thread-safe. Throws Error(internal, "NO_SCENE_READER").
  ReaderProcess start_reader();

  /// How the reader that was started last is confined; nothing before the first. Thread-safe, and waits for
  /// nothing.
  std::optional<Confinement> confinement() const;

  /// The program's only argument when it is started as a host; `run_as_host` is all that it has to do then.
  static constexpr const char* argument = "--host-of-scene-readers";
  static int run_as_host(const Work& work);

 private:
  void start_program();

  std::mutex mutex_;
  Socket control_;
  pid_t process_ = -1;
  mutable std::mutex confinement_mutex_;
  std::optional<Confinement> confinement_;
};

}  // namespace fogbank::service
