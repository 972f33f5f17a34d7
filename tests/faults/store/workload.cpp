#include "workload.h"

#include <algorithm>
#include <cstring>
#include <exception>
#include <functional>

#include "cache/store/store.h"
#include "cache/varied_records.h"
#include "core/error.h"
#include "core/files.h"
#include "core/sha256.h"
#include "render/checkpoint.h"
#include "render/film.h"
#include "service/blob_store.h"
#include "service/job_store.h"
#include "service/rpc_error.h"
#include "service/server.h"
#include "syscalls.h"

namespace fogbank::faults {

namespace fs = std::filesystem;

namespace {

constexpr size_t record_batches = 5;
constexpr size_t batch_records = 40;
constexpr int64_t most_bytes = 1 << 26;
const std::string identity = "scene, settings and build";

const std::string& transport() {
  static const std::string one = sha256("a scene");
  return one;
}

const std::vector<Spectrum>& emission() {
  static const std::vector<Spectrum> one{Spectrum(1)};
  return one;
}

std::string text_of(size_t size, char first) {
  std::string text(size, first);
  for (size_t i = 0; i < size; ++i) text[i] = static_cast<char>(first + static_cast<char>(i * i % 61));
  return text;
}

cache::RecordSet batch(size_t number) {
  return cache::RecordSet(cache::test::varied_records(batch_records, 1 + number));
}

std::string bytes_of(const cache::Record& record) {
  return {reinterpret_cast<const char*>(&record), sizeof record};
}

service::StoredJob job(int number, v1::JobState state) {
  service::StoredJob job;
  job.request.set_request_id("request-" + std::to_string(number));
  job.description.set_name("jobs/" + std::to_string(number));
  job.description.set_state(state);
  job.description.set_scene(text_of(300, 'A'));
  return job;
}

render::Checkpoint checkpoint() {
  render::Checkpoint checkpoint;
  checkpoint.passes = 3;
  checkpoint.samples = 12;
  for (int i = 0; i < 3; ++i) {
    auto tile = std::make_shared<render::TileFilm>();
    tile->passes = checkpoint.passes;
    tile->samples = checkpoint.samples;
    tile->sampled.resize(64);
    checkpoint.tiles.push_back(std::move(tile));
  }
  return checkpoint;
}

std::string reason_of_current_exception() {
  try {
    throw;
  } catch (const service::RpcError& error) {
    return error.reason();
  } catch (const Error& error) {
    return error.reason();
  } catch (const service::OptionError&) {
    return "OPTION";
  } catch (const std::exception& error) {
    return std::string("untyped: ") + error.what();
  }
}

}  // namespace

void use_stores(const fs::path& folder, Acknowledged& acknowledged) {
  const auto attempt = [&](const std::function<void()>& step) {
    try {
      step();
      return true;
    } catch (...) {
      acknowledged.errors.push_back(reason_of_current_exception());
      return false;
    }
  };
  const auto check_durable = [&](const fs::path& path) {
    const std::vector<std::string> lost = lost_at_power_cut(path);
    acknowledged.not_durable.insert(acknowledged.not_durable.end(), lost.begin(), lost.end());
  };
  attempt([&] {
    service::BlobStore blobs(folder / "blobs");
    for (const char first : {'A', 'B'}) {
      attempt([&] {
        const std::string bytes = text_of(200'000, first);
        const auto upload = blobs.begin(sha256(bytes), static_cast<int64_t>(bytes.size()), 0);
        constexpr size_t chunk = 64 << 10;
        for (size_t at = 0; at < bytes.size() && !upload->already_complete(); at += chunk)
          upload->append(std::string_view(bytes).substr(at, chunk));
        upload->finish();
        acknowledged.blobs[sha256(bytes)] = bytes;
        check_durable(blobs.find(sha256(bytes))->path);
      });
    }
  });
  attempt([&] {
    create_folder_durably(folder / "jobs");
    service::JobStore jobs(folder / "jobs" / "jobs.sqlite");
    const auto put = [&](const service::StoredJob& stored) {
      const std::string& name = stored.description.name();
      const bool done = attempt([&] { jobs.put({stored}); });
      if (done) {
        acknowledged.jobs[name] = stored.description.SerializeAsString();
        acknowledged.uncertain_jobs.erase(name);
        acknowledged.removed_jobs.erase(name);
        check_durable(folder / "jobs" / "jobs.sqlite-wal");
      } else {
        acknowledged.uncertain_jobs.insert(name);
      }
    };
    for (int number = 1; number <= 3; ++number) put(job(number, v1::JOB_STATE_QUEUED));
    put(job(2, v1::JOB_STATE_SUCCEEDED));
    const std::string removed = "jobs/3";
    const bool done = attempt([&] { jobs.remove({removed}); });
    acknowledged.jobs.erase(removed);
    // A job whose put has failed at the last sync may yet be found in the log by the next life; to remove
    // what this life doesn't have writes nothing.
    if (done && !acknowledged.uncertain_jobs.contains(removed)) {
      acknowledged.removed_jobs.insert(removed);
    } else {
      acknowledged.uncertain_jobs.insert(removed);
    }
  });
  attempt([&] {
    cache::StoredCache stored(folder / "caches" / transport(), transport());
    for (size_t number = acknowledged.record_batches; number < record_batches; ++number) {
      const bool done = attempt([&] { stored.append(batch(number), emission()); });
      if (!done) break;
      acknowledged.record_batches = number + 1;
      check_durable(stored.folder() / "manifest");
    }
  });
  attempt([&] {
    render::write_checkpoint(folder / "jobs" / "1.checkpoint", checkpoint(), identity);
    acknowledged.checkpoint = true;
    check_durable(folder / "jobs" / "1.checkpoint");
  });
  for (const std::string name : {"1.exr", "2.exr"}) {
    attempt([&] {
      const std::string bytes = text_of(50'000, name.front());
      write_file_durably(folder / "jobs" / name, bytes);
      acknowledged.images[name] = bytes;
      check_durable(folder / "jobs" / name);
    });
  }
}

Contents read_stores(const fs::path& folder, const Acknowledged& wanted) {
  Contents contents;
  const auto attempt = [&](const std::string& what, const std::function<void()>& step) {
    try {
      step();
    } catch (...) {
      contents.damages.push_back(what + ": " + reason_of_current_exception());
    }
  };
  for (const auto& [digest, bytes] : wanted.blobs) {
    attempt("blob", [&] {
      const auto blob = service::BlobStore(folder / "blobs").find_intact(digest);
      if (!blob) throw Error(ErrorKind::not_found, "BLOB_MISSING", digest);
      contents.blobs[digest] = read_file(blob->path, most_bytes);
    });
  }
  attempt("jobs", [&] {
    create_folder_durably(folder / "jobs");
    service::JobStore jobs(folder / "jobs" / "jobs.sqlite");
    for (const service::StoredJob& stored : jobs.load())
      contents.jobs[stored.description.name()] = stored.description.SerializeAsString();
    if (!jobs.complete()) contents.damages.emplace_back("jobs: rows were lost");
  });
  attempt("cache", [&] {
    cache::StoredCache stored(folder / "caches" / transport(), transport());
    const cache::LoadedRecords loaded = stored.load(emission());
    for (const cache::Record& record : cache::test::all(loaded.records))
      contents.records.push_back(bytes_of(record));
    std::ranges::sort(contents.records);
    for (const cache::Damage& damage : loaded.damages) contents.damages.push_back("cache: " + damage.reason);
  });
  if (wanted.checkpoint) {
    attempt("checkpoint", [&] {
      const render::Checkpoint read = render::read_checkpoint(folder / "jobs" / "1.checkpoint", identity);
      Sha256 digest;
      digest.update(std::to_string(read.passes) + " " + std::to_string(read.samples));
      for (const auto& tile : read.tiles)
        digest.update(tile->sampled.data(), tile->sampled.size() * sizeof tile->sampled[0]);
      contents.checkpoint = digest.finish();
    });
  }
  for (const auto& [name, bytes] : wanted.images) {
    attempt("image", [&] {
      contents.images[name] = read_file(folder / "jobs" / name, most_bytes);
      // A job's row has the image's hash.
      if (sha256(contents.images[name]) != sha256(bytes))
        throw Error(ErrorKind::data_loss, "IMAGE_DAMAGED", name);
    });
  }
  return contents;
}

std::vector<std::string> missing(const Contents& contents, const Acknowledged& acknowledged) {
  std::vector<std::string> missing = contents.damages;
  for (const auto& [digest, bytes] : acknowledged.blobs) {
    const auto found = contents.blobs.find(digest);
    if (found == contents.blobs.end() || found->second != bytes) missing.push_back("blob " + digest);
  }
  for (const auto& [name, description] : acknowledged.jobs) {
    if (acknowledged.uncertain_jobs.contains(name)) continue;
    const auto found = contents.jobs.find(name);
    if (found == contents.jobs.end() || found->second != description) missing.push_back(name);
  }
  for (const std::string& name : acknowledged.removed_jobs) {
    if (contents.jobs.contains(name) && !acknowledged.uncertain_jobs.contains(name))
      missing.push_back(name + " is back");
  }
  for (size_t number = 0; number < acknowledged.record_batches; ++number) {
    for (const cache::Record& record : cache::test::all(batch(number))) {
      if (!std::ranges::binary_search(contents.records, bytes_of(record)))
        missing.push_back("a record of batch " + std::to_string(number));
    }
  }
  if (acknowledged.checkpoint && contents.checkpoint.empty()) missing.emplace_back("checkpoint");
  for (const auto& [name, bytes] : acknowledged.images) {
    const auto found = contents.images.find(name);
    if (found == contents.images.end() || found->second != bytes) missing.push_back(name);
  }
  return missing;
}

}  // namespace fogbank::faults
