#include "service/job_store.h"

#include <pthread.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <cstdint>
#include <exception>
#include <utility>

#include "core/failpoint.h"
#include "core/files.h"
#include "core/sha256.h"
#include "service/messages.h"
#include "service/rpc_error.h"
#include "service/server.h"

namespace fogbank::service {

namespace fs = std::filesystem;
using grpc::StatusCode;

namespace {

/// PRAGMA user_version of the layout below. A change of the layout counts it up and migrates older ones.
constexpr int layout_version = 1;
constexpr const char* layout = R"(
  CREATE TABLE jobs (
    name TEXT PRIMARY KEY,
    request BLOB NOT NULL,
    description BLOB NOT NULL,
    checksum TEXT NOT NULL
  ) STRICT;
  PRAGMA user_version = 1;
  PRAGMA application_id = 1718576994;
)";
constexpr int64_t application_id = 0x666f6762;  // "fogb": tells damage from a layout of the future

/// Rather than a disk or a folder that doesn't let us.
bool is_damage(int code) {
  const int primary = code & 0xff;
  return primary == SQLITE_CORRUPT || primary == SQLITE_NOTADB || primary == SQLITE_FORMAT ||
         primary == SQLITE_ERROR || primary == SQLITE_SCHEMA;
}

/// SQLITE_* as an error of the wire contract.
class DatabaseError : public RpcError {
 public:
  explicit DatabaseError(int code)
      : RpcError((code & 0xff) == SQLITE_FULL ? StatusCode::RESOURCE_EXHAUSTED : StatusCode::INTERNAL,
                 (code & 0xff) == SQLITE_FULL ? "DISK_FULL" : "STORAGE_ERROR",
                 std::string("the database of jobs: ") + sqlite3_errstr(code)),
        code_(code) {}
  int database_code() const { return code_; }

 private:
  int code_;
};

void check(int code) {
  if (code != SQLITE_OK && code != SQLITE_ROW && code != SQLITE_DONE) throw DatabaseError(code);
}

void execute(sqlite3* connection, const char* sql) {
  check(sqlite3_exec(connection, sql, nullptr, nullptr, nullptr));
}

/// A prepared statement, run once.
class Statement {
 public:
  Statement(sqlite3* connection, const char* sql) {
    check(sqlite3_prepare_v2(connection, sql, -1, &statement_, nullptr));
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  void bind_text(int index, const std::string& text) {
    check(sqlite3_bind_text64(statement_, index, text.data(), text.size(), SQLITE_TRANSIENT, SQLITE_UTF8));
  }
  void bind_blob(int index, const std::string& bytes) {
    check(sqlite3_bind_blob64(statement_, index, bytes.data(), bytes.size(), SQLITE_TRANSIENT));
  }
  /// True while there is a row.
  bool step() {
    const int code = sqlite3_step(statement_);
    check(code);
    return code == SQLITE_ROW;
  }
  std::string column(int index) const {
    const void* bytes = sqlite3_column_blob(statement_, index);
    const auto size = static_cast<size_t>(sqlite3_column_bytes(statement_, index));
    return bytes == nullptr ? std::string() : std::string(static_cast<const char*>(bytes), size);
  }
  int64_t integer(int index) const { return sqlite3_column_int64(statement_, index); }

 private:
  sqlite3_stmt* statement_ = nullptr;
};

int64_t number(sqlite3* connection, const char* sql) {
  Statement statement(connection, sql);
  return statement.step() ? statement.integer(0) : 0;
}

std::string checksum_of(const std::string& name, const std::string& request, const std::string& description) {
  Sha256 hash;
  for (const std::string* const part : {&name, &request, &description}) {
    hash.update(std::to_string(part->size()) + ":");
    hash.update(*part);
  }
  return hash.finish();
}

void put_row(sqlite3* connection, const StoredJob& job) {
  Statement statement(connection,
                      "INSERT INTO jobs (name, request, description, checksum) VALUES (?, ?, ?, ?) "
                      "ON CONFLICT (name) DO UPDATE SET request = excluded.request, "
                      "description = excluded.description, checksum = excluded.checksum");
  const std::string& name = job.description.name();
  const std::string request = canonical_bytes(job.request);
  const std::string description = canonical_bytes(job.description);
  statement.bind_text(1, name);
  statement.bind_blob(2, request);
  statement.bind_blob(3, description);
  statement.bind_text(4, checksum_of(name, request, description));
  statement.step();
}

}  // namespace

void JobStore::CloseConnection::operator()(sqlite3* connection) const { sqlite3_close_v2(connection); }

JobStore::Connection JobStore::open(const fs::path& path) {
  sqlite3* raw = nullptr;
  const int code = sqlite3_open_v2(
      path.c_str(), &raw,
      SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_FULLMUTEX | SQLITE_OPEN_EXRESCODE, nullptr);
  Connection connection(raw);
  check(code);
  // Exclusive: no shared memory beside the file, and nobody else's writes. The server has locked the folder.
  execute(connection.get(),
          "PRAGMA locking_mode = EXCLUSIVE; PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;"
          "PRAGMA cell_size_check = ON");
  Statement check_statement(connection.get(), "PRAGMA quick_check(1)");
  if (check_statement.step() && check_statement.column(0) != "ok") throw DatabaseError(SQLITE_CORRUPT);
  const int64_t version = number(connection.get(), "PRAGMA user_version");
  const int64_t application = number(connection.get(), "PRAGMA application_id");
  if (application == 0 && version == 0) {
    execute(connection.get(), (std::string("BEGIN IMMEDIATE;") + layout + "COMMIT").c_str());
  } else if (application != application_id || version < 1) {
    throw DatabaseError(SQLITE_NOTADB);
  } else if (version > layout_version) {
    throw OptionError("the data directory was written by a newer fogbankd (jobs of layout " +
                      std::to_string(version) + "; this one knows " + std::to_string(layout_version) + ")");
  }
  // The first write makes the log. SQLite syncs its name, too, but takes no notice where that fails.
  execute(connection.get(), ("PRAGMA user_version = " + std::to_string(layout_version)).c_str());
  sync_folder(path.parent_path());
  return connection;
}

JobStore::JobStore(fs::path path) : path_(std::move(path)) {
  try {
    connection_ = open(path_);
    bool lost = false;
    loaded_ = read_rows(connection_.get(), lost);
    complete_ = !lost;
  } catch (const DatabaseError& error) {
    if (!is_damage(error.database_code())) throw;
    recover();
  }
  thread_ = std::thread([this] { work(); });
}

JobStore::~JobStore() {
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

std::vector<StoredJob> JobStore::load() { return std::move(loaded_); }

std::vector<StoredJob> JobStore::read_rows(sqlite3* connection, bool& lost) {
  std::vector<StoredJob> jobs;
  try {
    Statement rows(connection, "SELECT name, request, description, checksum FROM jobs ORDER BY name");
    while (rows.step()) {
      const std::string name = rows.column(0);
      StoredJob job;
      if (rows.column(3) == checksum_of(name, rows.column(1), rows.column(2)) &&
          job.request.ParseFromString(rows.column(1)) && job.description.ParseFromString(rows.column(2))) {
        jobs.push_back(std::move(job));
      } else {
        lost = true;
        spdlog::error("the database of jobs: a row is damaged and passed over");
      }
    }
  } catch (const DatabaseError& error) {
    if (!is_damage(error.database_code())) throw;
    lost = true;
    spdlog::error("{}", error.what());
  }
  return jobs;
}

void JobStore::recover() {
  complete_ = false;
  connection_.reset();
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const std::string suffix =
      ".damaged-" + std::to_string(std::chrono::duration_cast<std::chrono::microseconds>(now).count());
  fs::path aside = path_;
  aside += suffix;
  fs::rename(path_, aside);
  for (const char* const companion : {"-wal", "-shm"}) {
    fs::path from = path_;
    from += companion;
    fs::path to = aside;
    to += companion;
    if (fs::exists(from)) fs::rename(from, to);
  }
  sqlite3* raw = nullptr;
  const int code = sqlite3_open_v2(
      aside.c_str(), &raw, SQLITE_OPEN_READWRITE | SQLITE_OPEN_FULLMUTEX | SQLITE_OPEN_EXRESCODE, nullptr);
  const Connection damaged(raw);
  bool lost = true;
  if (code == SQLITE_OK) loaded_ = read_rows(damaged.get(), lost);
  spdlog::error("the database of jobs was damaged; it is kept as {}, and {} jobs could be read from it",
                aside.filename().string(), loaded_.size());
  connection_ = open(path_);
  execute(connection_.get(), "BEGIN IMMEDIATE");
  for (const StoredJob& job : loaded_) put_row(connection_.get(), job);
  execute(connection_.get(), "COMMIT");
}

void JobStore::put(const std::vector<StoredJob>& jobs) {
  if (jobs.empty()) return;
  write([&jobs](sqlite3* connection) {
    for (const StoredJob& job : jobs) put_row(connection, job);
  });
}

void JobStore::remove(const std::vector<std::string>& names) {
  if (names.empty()) return;
  write([&names](sqlite3* connection) {
    for (const std::string& name : names) {
      Statement statement(connection, "DELETE FROM jobs WHERE name = ?");
      statement.bind_text(1, name);
      statement.step();
    }
  });
}

void JobStore::write(std::function<void(sqlite3*)> run) {
  std::future<void> done;
  {
    const std::lock_guard lock(mutex_);
    waiting_.push_back({.run = std::move(run), .done = {}});
    done = waiting_.back().done.get_future();
  }
  wake_.notify_one();
  done.get();
}

void JobStore::commit(const std::vector<Write*>& writes) {
  FOGBANK_FAILPOINT("jobs.before_begin");
  execute(connection_.get(), "BEGIN IMMEDIATE");
  try {
    for (const Write* const write : writes) write->run(connection_.get());
    FOGBANK_FAILPOINT("jobs.before_commit");
    execute(connection_.get(), "COMMIT");
    FOGBANK_FAILPOINT("jobs.after_commit");
  } catch (...) {
    // Some errors have rolled back by themselves; then there is nothing to roll back.
    if (sqlite3_get_autocommit(connection_.get()) == 0)
      sqlite3_exec(connection_.get(), "ROLLBACK", nullptr, nullptr, nullptr);
    throw;
  }
}

void JobStore::work() {
  pthread_setname_np(pthread_self(), "job-store");
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [this] { return closed_ || !waiting_.empty(); });
    if (waiting_.empty()) return;
    std::deque<Write> taken;
    taken.swap(waiting_);
    lock.unlock();
    std::vector<Write*> all;
    all.reserve(taken.size());
    for (Write& write : taken) all.push_back(&write);
    try {
      commit(all);
      for (Write* const write : all) write->done.set_value();
    } catch (...) {
      // One by one, so that nobody is refused for what another wanted.
      for (Write* const write : all) {
        try {
          commit({write});
          write->done.set_value();
        } catch (...) {
          write->done.set_exception(std::current_exception());
        }
      }
    }
    lock.lock();
  }
}

}  // namespace fogbank::service
