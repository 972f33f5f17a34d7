// Streams a file to a client in chunks, each with size and hash of the whole file, so that a broken download
// goes on from where it broke.
#pragma once

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>

#include "core/files.h"
#include "service/answers.h"
#include "service/limits.h"
#include "service/temporary_file.h"

namespace fogbank::service {

/// A file that does not change while it is streamed.
struct StreamedFile {
  std::filesystem::path path;
  int64_t size = 0;
  std::string sha256;       ///< 64 lower-case hexadecimal digits
  std::string damage;       ///< reason of the error for a file that is not as it was
  TemporaryFile temporary;  ///< removed with the stream, if it holds a file
};

/// A chunk is read, written to the client, and only then the next one is read. `Response` is filled by
/// `set_chunk(Response&, const StreamedFile&, int64_t offset, std::string bytes)`.
template <typename Response>
class FileStream final : public grpc::ServerWriteReactor<Response> {
 public:
  using SetChunk = void (*)(Response&, const StreamedFile&, int64_t offset, std::string bytes);

  /// `open` runs in the queue, where reading happens too.
  FileStream(TaskQueue& queue, int64_t offset, std::function<StreamedFile()> open, SetChunk set_chunk)
      : queue_(queue), next_(offset), open_(std::move(open)), set_chunk_(set_chunk) {
    post([this] {
      file_ = open_();
      check();
      send();
    });
  }

  void OnWriteDone(bool ok) override {
    if (!ok) {
      this->Finish(grpc::Status::CANCELLED);
    } else if (next_ == file_.size) {
      this->Finish(grpc::Status::OK);
    } else {
      post([this] { send(); });
    }
  }

  void OnDone() override { delete this; }

 private:
  template <typename Work>
  void post(Work work) {
    const bool posted = queue_.post([this, work] {
      try {
        work();
      } catch (...) {
        this->Finish(status_of(std::current_exception()));
      }
    });
    if (!posted) this->Finish(shutting_down_status());
  }

  void check() const {
    if (next_ < 0 || next_ > file_.size) {
      throw RpcError(grpc::StatusCode::OUT_OF_RANGE, "INVALID_OFFSET",
                     "offset must be 0 to " + std::to_string(file_.size), {{"field", "offset"}});
    }
    std::error_code error;
    if (std::filesystem::file_size(file_.path, error) != static_cast<uintmax_t>(file_.size) || error)
      throw damaged();
  }

  void send() {
    const int64_t size = std::min(limits::max_download_chunk_bytes, file_.size - next_);
    std::string bytes = read_range(file_.path, next_, size);
    if (static_cast<int64_t>(bytes.size()) != size) throw damaged();
    set_chunk_(response_, file_, next_, std::move(bytes));
    next_ += size;
    this->StartWrite(&response_);
  }

  RpcError damaged() const {
    return {grpc::StatusCode::DATA_LOSS, file_.damage, "the stored file was changed or lost"};
  }

  TaskQueue& queue_;
  int64_t next_;
  std::function<StreamedFile()> open_;
  SetChunk set_chunk_;
  StreamedFile file_;
  Response response_;
};

}  // namespace fogbank::service
