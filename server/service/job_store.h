// Jobs on the disk: an SQLite database with one connection and one thread that writes.
#pragma once

#include <sqlite3.h>

#include <condition_variable>
#include <deque>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "fogbank/v1/render.pb.h"

namespace fogbank::service {

/// A job as it is kept.
struct StoredJob {
  v1::CreateJobRequest request;
  v1::Job description;
};

/// What `put` and `remove` return from is on the disk: write-ahead log, synchronous=FULL. Writes that wait at
/// the same time share one transaction. Each row has a checksum, as SQLite's pages have none. Thread-safe.
class JobStore {
 public:
  /// Opens or makes the database. One that is damaged is renamed to *.damaged-{time}, and what can still be
  /// read of it is taken over. Throws OptionError for one that a newer version has written, and RpcError as
  /// `put`.
  explicit JobStore(std::filesystem::path path);
  /// Writes what waits.
  ~JobStore();

  /// All jobs in the order of their ids; rows with a wrong checksum are passed over with a log line. Meant
  /// for the start.
  std::vector<StoredJob> load();
  /// Whether all that was ever put is here: false once rows were lost, for as long as the server runs.
  bool complete() const { return complete_; }

  /// Adds jobs, or replaces those of the same names, all or none. Returns when they are on the disk. Throws
  /// RpcError DISK_FULL, STORAGE_ERROR: then nothing has changed.
  void put(const std::vector<StoredJob>& jobs);
  /// Removes jobs by name; unknown ones are no error. As `put`.
  void remove(const std::vector<std::string>& names);

 private:
  struct CloseConnection {
    void operator()(sqlite3* connection) const;
  };
  using Connection = std::unique_ptr<sqlite3, CloseConnection>;
  struct Write {
    std::function<void(sqlite3*)> run;
    std::promise<void> done;
  };

  static Connection open(const std::filesystem::path& path);
  /// The rows that can be read; `lost` is set when there were others.
  static std::vector<StoredJob> read_rows(sqlite3* connection, bool& lost);
  void recover();
  void write(std::function<void(sqlite3*)> run);
  void work();
  /// In one transaction. Throws as `put`.
  void commit(const std::vector<Write*>& writes);

  const std::filesystem::path path_;
  Connection connection_;  ///< of the writing thread, once that runs
  bool complete_ = true;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<Write> waiting_;
  bool closed_ = false;
  std::vector<StoredJob> loaded_;
  std::thread thread_;
};

}  // namespace fogbank::service
