#include "service/stream_pump.h"

#include <pthread.h>

#include <algorithm>

namespace fogbank::service {

namespace {

/// News come with every tile. Asking all waiting streams costs about a microsecond each; the pause grows with
/// their number, so that a thousand watchers cost a percent of a core.
Clock::duration news_pause(size_t waiting) {
  return std::chrono::milliseconds(10) + std::chrono::microseconds(100) * static_cast<int64_t>(waiting);
}

constexpr Clock::duration stall_check_interval = std::chrono::seconds(5);

}  // namespace

StreamPump::StreamPump()
    : next_stall_check_(Clock::now() + stall_check_interval), thread_([this] { work(); }) {}

StreamPump::~StreamPump() { close(); }

void StreamPump::add(const std::shared_ptr<PumpedStream>& stream) {
  {
    const std::lock_guard lock(mutex_);
    streams_.emplace(stream.get(), stream);
    ready_.push_back(stream);
  }
  wake_.notify_one();
}

void StreamPump::ready(const std::shared_ptr<PumpedStream>& stream) {
  {
    const std::lock_guard lock(mutex_);
    if (!streams_.contains(stream.get())) return;
    ready_.push_back(stream);
  }
  wake_.notify_one();
}

void StreamPump::news() {
  {
    const std::lock_guard lock(mutex_);
    if (news_) return;
    news_ = true;
    if (waiting_.empty()) return;
  }
  wake_.notify_one();
}

size_t StreamPump::streams() const {
  const std::lock_guard lock(mutex_);
  return streams_.size();
}

void StreamPump::close() {
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
  }
  wake_.notify_one();
  if (thread_.joinable()) thread_.join();
}

Clock::time_point StreamPump::collect(Clock::time_point now) {
  const bool news = news_ && now >= next_news_;
  if (news) {
    news_ = false;
    next_news_ = now + news_pause(waiting_.size());
  }
  Clock::time_point next = next_stall_check_;
  if (news_) next = std::min(next, next_news_);
  for (auto it = waiting_.begin(); it != waiting_.end();) {
    if (news || it->second <= now) {
      ready_.push_back(streams_.at(it->first));
      it = waiting_.erase(it);
    } else {
      next = std::min(next, it->second);
      ++it;
    }
  }
  return next;
}

void StreamPump::work() {
  pthread_setname_np(pthread_self(), "stream-pump");
  std::unique_lock lock(mutex_);
  while (!closed_) {
    const Clock::time_point now = Clock::now();
    const Clock::time_point next = collect(now);
    if (now >= next_stall_check_) {
      next_stall_check_ = now + stall_check_interval;
      const auto all = streams_;
      lock.unlock();
      for (const auto& [key, stream] : all) stream->check_stall(now);
      lock.lock();
      continue;
    }
    if (ready_.empty()) {
      wake_.wait_until(lock, next);
      continue;
    }
    // One round over those that are ready now; a stream that is ready again at once waits for the others.
    std::deque<std::shared_ptr<PumpedStream>> round;
    round.swap(ready_);
    for (std::shared_ptr<PumpedStream>& stream : round) {
      waiting_.erase(stream.get());
      lock.unlock();
      const PumpedStream::Step step = stream->step();
      lock.lock();
      if (step.state == PumpedStream::State::finished) {
        streams_.erase(stream.get());
      } else if (step.state == PumpedStream::State::waiting && streams_.contains(stream.get())) {
        waiting_[stream.get()] = step.retry_at;
      }
    }
    lock.unlock();
    round.clear();
    lock.lock();
  }
}

}  // namespace fogbank::service
