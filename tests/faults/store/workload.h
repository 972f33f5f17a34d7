// All stores of a data directory, made to write, and held to what they acknowledged.
#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "fogbank/v1/render.pb.h"

namespace fogbank::faults {

/// What the stores have said to be on the disk.
struct Acknowledged {
  std::map<std::string, std::string> blobs;  ///< bytes by SHA-256
  std::map<std::string, std::string> jobs;   ///< descriptions by name, as last put
  std::set<std::string> uncertain_jobs;      ///< a change of them failed: they are as before or as after
  std::set<std::string> removed_jobs;
  size_t record_batches = 0;  ///< of the cache
  bool checkpoint = false;
  std::map<std::string, std::string> images;  ///< bytes by name
  std::vector<std::string> errors;            ///< reasons of what failed
  std::vector<std::string> not_durable;       ///< what a power cut would have taken at an acknowledgement
};

/// Uploads two blobs, puts, changes and removes jobs, appends records until segments are united, writes a
/// checkpoint and two images. A step that fails leaves its reason; any other exception than those that the
/// stores document leaves "untyped".
void use_stores(const std::filesystem::path& folder, Acknowledged& acknowledged);

/// Opens the stores anew and reads everything.
struct Contents {
  std::map<std::string, std::string> blobs;
  std::map<std::string, std::string> jobs;
  std::vector<std::string> records;  ///< bytes, sorted
  std::string checkpoint;            ///< a digest; empty: none
  std::map<std::string, std::string> images;
  std::vector<std::string> damages;  ///< that the stores have found

  bool operator==(const Contents& other) const = default;
};
Contents read_stores(const std::filesystem::path& folder, const Acknowledged& wanted);

/// Sentences on what was acknowledged and is not there; none when all is well.
std::vector<std::string> missing(const Contents& contents, const Acknowledged& acknowledged);

}  // namespace fogbank::faults
