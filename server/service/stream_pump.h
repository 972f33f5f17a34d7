// The thread that feeds all WatchJob streams, so that neither gRPC's threads nor the render threads ever
// encode a tile or wait for a client.
#pragma once

#include <condition_variable>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <thread>

#include "service/scheduling/clock.h"

namespace fogbank::service {

/// A stream that can be asked for its next step.
class PumpedStream {
 public:
  enum class State { writing, waiting, finished };
  struct Step {
    State state = State::finished;
    Clock::time_point retry_at;  ///< with State::waiting
  };

  virtual ~PumpedStream() = default;
  /// Starts the next write if there is something to write and none is outstanding. Called by the pump's
  /// thread only.
  virtual Step step() = 0;
  /// Breaks the stream off when its write has been outstanding for too long. Called by the pump's thread
  /// only.
  virtual void check_stall(Clock::time_point now) = 0;
};

/// Thread-safe.
class StreamPump {
 public:
  StreamPump();
  /// As `close`.
  ~StreamPump();

  /// Begins to feed a stream.
  void add(const std::shared_ptr<PumpedStream>& stream);
  /// A stream can take its next step: its write is done, or its client has gone.
  void ready(const std::shared_ptr<PumpedStream>& stream);
  /// Some job has something new.
  void news();
  size_t streams() const;
  void close();

 private:
  void work();
  /// Moves the waiting streams whose time has come to `ready_`; returns when to look next. With `mutex_`
  /// held.
  Clock::time_point collect(Clock::time_point now);

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::map<const PumpedStream*, std::shared_ptr<PumpedStream>> streams_;
  std::deque<std::shared_ptr<PumpedStream>> ready_;
  std::map<const PumpedStream*, Clock::time_point> waiting_;  ///< with the time to ask again
  bool news_ = false;
  Clock::time_point next_news_;  ///< news are looked at together, not one by one
  Clock::time_point next_stall_check_;
  bool closed_ = false;
  std::thread thread_;
};

}  // namespace fogbank::service
