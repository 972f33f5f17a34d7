#include "render/checkpoint.h"

#include <fcntl.h>
#include <unistd.h>

#include <bit>
#include <cstring>
#include <type_traits>

#include "core/error.h"
#include "core/failpoint.h"
#include "core/files.h"
#include "core/sha256.h"

namespace fogbank::render {

// Layout, little-endian: magic, version, length and bytes of the identity, fixed fields, history,
// progression, stage, tiles (the layers `sampled`, `narrow` and `cached`: pixel count, then both sums of each
// pixel), and SHA-256 of all before as 64 hexadecimal digits.
static_assert(std::endian::native == std::endian::little);
static_assert(sizeof(PixelSums) == 6 * sizeof(double) && std::is_trivially_copyable_v<PixelSums>);

namespace {

constexpr std::string_view magic = "fogbankC";
constexpr uint32_t version = 3;
constexpr size_t digest_bytes = 64;

[[noreturn]] void damaged(const std::string& why) {
  throw Error(ErrorKind::data_loss, "CHECKPOINT_DAMAGED", "the checkpoint can't be used: " + why);
}

/// A file that is hashed as it is written.
class HashedFile {
 public:
  explicit HashedFile(std::filesystem::path path)
      : path_(std::move(path)), file_(open_file(path_, O_WRONLY | O_CREAT | O_TRUNC)) {}

  void put(std::string_view bytes) {
    hash_.update(bytes);
    write_all(file_, bytes, path_);
  }
  void finish() {
    write_all(file_, hash_.finish(), path_);
    sync_file(file_, path_);
  }

 private:
  std::filesystem::path path_;
  FileDescriptor file_;
  Sha256 hash_;
};

/// Values one after the other.
class Encoder {
 public:
  template <typename T>
  void put(const T& value) {
    static_assert(std::is_arithmetic_v<T>);
    char bytes[sizeof(T)];
    std::memcpy(bytes, &value, sizeof(T));
    bytes_.append(bytes, sizeof(T));
  }
  void put(const std::optional<double>& value) {
    put(static_cast<uint8_t>(value.has_value()));
    put(value.value_or(0.0));
  }
  void put(std::string_view text) {
    put(static_cast<uint64_t>(text.size()));
    bytes_.append(text);
  }
  /// Without their number.
  void put_bytes(std::string_view bytes) { bytes_.append(bytes); }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

/// Every length is held against what is left before anything is allocated.
class Decoder {
 public:
  explicit Decoder(std::string_view bytes) : rest_(bytes) {}

  std::string_view take(uint64_t size) {
    if (size > rest_.size()) damaged("it ends too soon");
    const std::string_view taken = rest_.substr(0, size);
    rest_.remove_prefix(size);
    return taken;
  }
  template <typename T>
  T get() {
    T value;
    std::memcpy(&value, take(sizeof(T)).data(), sizeof(T));
    return value;
  }
  std::optional<double> get_optional() {
    const auto present = get<uint8_t>();
    const auto value = get<double>();
    return present != 0 ? std::optional(value) : std::nullopt;
  }
  /// Number of elements of at least `smallest` bytes each.
  uint64_t get_count(size_t smallest) {
    const auto count = get<uint64_t>();
    if (count > rest_.size() / smallest) damaged("it ends too soon");
    return count;
  }
  bool at_end() const { return rest_.empty(); }

 private:
  std::string_view rest_;
};

void put(Encoder& encoder, const HistoryEntry& entry) {
  encoder.put(entry.cpu_seconds);
  encoder.put(entry.wall_seconds);
  encoder.put(entry.samples);
  encoder.put(entry.records);
  encoder.put(entry.epoch);
  encoder.put(entry.estimate.noise);
  encoder.put(entry.estimate.disagreement);
  encoder.put(entry.estimate.bias);
  encoder.put(entry.estimate.error);
  encoder.put(static_cast<uint8_t>(entry.estimate.true_error.has_value()));
  const TrueError error = entry.estimate.true_error.value_or(TrueError{});
  encoder.put(error.relative_error);
  encoder.put(error.median);
  encoder.put(error.percentile_99);
  encoder.put(error.relative_mse);
}

HistoryEntry get_history_entry(Decoder& decoder) {
  HistoryEntry entry;
  entry.cpu_seconds = decoder.get<double>();
  entry.wall_seconds = decoder.get<double>();
  entry.samples = decoder.get<uint32_t>();
  entry.records = decoder.get<uint64_t>();
  entry.epoch = decoder.get<uint64_t>();
  entry.estimate.noise = decoder.get_optional();
  entry.estimate.disagreement = decoder.get<double>();
  entry.estimate.bias = decoder.get<double>();
  entry.estimate.error = decoder.get_optional();
  const bool has_true_error = decoder.get<uint8_t>() != 0;
  TrueError error;
  error.relative_error = decoder.get<double>();
  error.median = decoder.get<double>();
  error.percentile_99 = decoder.get<double>();
  error.relative_mse = decoder.get<double>();
  if (has_true_error) entry.estimate.true_error = error;
  return entry;
}

void put(Encoder& encoder, const Progression::State& state) {
  encoder.put(static_cast<uint8_t>(state.prepares));
  encoder.put(state.stages);
  encoder.put(state.stage_error);
  encoder.put(state.aim);
  encoder.put(static_cast<uint8_t>(state.begin_with_pass));
  encoder.put(state.decision_at);
  encoder.put(static_cast<uint64_t>(state.looks.size()));
  for (const Progression::Look& look : state.looks) {
    encoder.put(look.samples);
    encoder.put(look.disagreement);
  }
  encoder.put(state.cached_until);
  encoder.put(state.preparation_seconds);
  encoder.put(state.last_stage_seconds);
  encoder.put(state.growth);
  encoder.put(state.last_bias);
}

Progression::State get_progression(Decoder& decoder) {
  Progression::State state;
  state.prepares = decoder.get<uint8_t>() != 0;
  state.stages = decoder.get<uint32_t>();
  state.stage_error = decoder.get<double>();
  state.aim = decoder.get<double>();
  state.begin_with_pass = decoder.get<uint8_t>() != 0;
  state.decision_at = decoder.get<uint32_t>();
  state.looks.resize(decoder.get_count(sizeof(uint32_t) + sizeof(double)));
  for (Progression::Look& look : state.looks) {
    look.samples = decoder.get<uint32_t>();
    look.disagreement = decoder.get<double>();
  }
  state.cached_until = decoder.get<uint32_t>();
  state.preparation_seconds = decoder.get<double>();
  state.last_stage_seconds = decoder.get<double>();
  state.growth = decoder.get<double>();
  state.last_bias = decoder.get<double>();
  return state;
}

/// What all tiles have in common, of their cached layers.
struct CachedLayers {
  uint32_t first_sample = 0;
  SampleCounts samples;
};

void put(Encoder& encoder, const CachedStage& stage, const CachedLayers& layers) {
  encoder.put(static_cast<uint64_t>(stage.records.size()));
  encoder.put_bytes(
      {reinterpret_cast<const char*>(stage.records.data()), stage.records.size() * sizeof(uint64_t)});
  encoder.put(std::string_view(stage.integrator));
  encoder.put(std::string_view(stage.survey));
  encoder.put(stage.reserved_seconds);
  encoder.put(layers.first_sample);
  encoder.put(layers.samples.even);
  encoder.put(layers.samples.odd);
}

std::shared_ptr<const CachedStage> get_stage(Decoder& decoder, CachedLayers& layers) {
  auto stage = std::make_shared<CachedStage>();
  stage->records.resize(decoder.get_count(sizeof(uint64_t)));
  const std::string_view ids = decoder.take(stage->records.size() * sizeof(uint64_t));
  if (!ids.empty()) std::memcpy(stage->records.data(), ids.data(), ids.size());
  stage->integrator = decoder.take(decoder.get<uint64_t>());
  stage->survey = decoder.take(decoder.get<uint64_t>());
  stage->reserved_seconds = decoder.get<double>();
  layers.first_sample = decoder.get<uint32_t>();
  layers.samples.even = decoder.get<uint32_t>();
  layers.samples.odd = decoder.get<uint32_t>();
  return stage;
}

void put(HashedFile& file, const std::vector<PixelSums>& layer) {
  Encoder count;
  count.put(static_cast<uint64_t>(layer.size()));
  file.put(count.bytes());
  file.put({reinterpret_cast<const char*>(layer.data()), layer.size() * sizeof(PixelSums)});
}

std::vector<PixelSums> get_layer(Decoder& decoder) {
  std::vector<PixelSums> layer(decoder.get_count(sizeof(PixelSums)));
  const std::string_view sums = decoder.take(layer.size() * sizeof(PixelSums));
  if (!sums.empty()) std::memcpy(static_cast<void*>(layer.data()), sums.data(), sums.size());
  return layer;
}

std::string head_of(const Checkpoint& checkpoint, const std::string& identity) {
  Encoder encoder;
  encoder.put(version);
  encoder.put(std::string_view(identity));
  encoder.put(checkpoint.passes);
  encoder.put(checkpoint.samples);
  encoder.put(checkpoint.rays);
  encoder.put(checkpoint.invalid_samples);
  encoder.put(checkpoint.render_seconds);
  encoder.put(checkpoint.cpu_seconds);
  encoder.put(static_cast<uint64_t>(checkpoint.history.size()));
  for (const HistoryEntry& entry : checkpoint.history) put(encoder, entry);
  put(encoder, checkpoint.progression);
  encoder.put(static_cast<uint8_t>(checkpoint.stage != nullptr));
  if (checkpoint.stage) {
    CachedLayers layers;
    if (!checkpoint.tiles.empty()) {
      const TileFilm& any = *checkpoint.tiles.front();
      layers = {.first_sample = any.first_cached_sample, .samples = any.cached_samples};
    }
    put(encoder, *checkpoint.stage, layers);
  }
  encoder.put(static_cast<uint64_t>(checkpoint.tiles.size()));
  return encoder.bytes();
}

}  // namespace

void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint,
                      const std::string& identity) {
  std::filesystem::path temporary = path;
  temporary += ".tmp";
  try {
    FOGBANK_FAILPOINT("checkpoint.before_write");
    HashedFile file(temporary);
    file.put(magic);
    file.put(head_of(checkpoint, identity));
    for (const auto& tile : checkpoint.tiles) {
      put(file, tile->sampled);
      put(file, tile->narrow);
      put(file, tile->cached);
    }
    FOGBANK_FAILPOINT("checkpoint.before_sync");
    file.finish();
    FOGBANK_FAILPOINT("checkpoint.before_publish");
    rename_durably(temporary, path);
    FOGBANK_FAILPOINT("checkpoint.after_publish");
  } catch (...) {
    ::unlink(temporary.c_str());
    throw;
  }
}

Checkpoint read_checkpoint(const std::filesystem::path& path, const std::string& identity) {
  constexpr int64_t max_bytes = int64_t{64} << 30;
  const std::string file = read_file(path, max_bytes);
  if (file.size() < magic.size() + digest_bytes || !file.starts_with(magic)) damaged("it is no checkpoint");
  const std::string_view hashed = std::string_view(file).substr(0, file.size() - digest_bytes);
  if (sha256(hashed) != std::string_view(file).substr(hashed.size())) damaged("its hash is wrong");

  Decoder decoder(hashed.substr(magic.size()));
  if (decoder.get<uint32_t>() != version) damaged("it is of another version");
  if (decoder.take(decoder.get<uint64_t>()) != identity) damaged("it is of another job or build");
  Checkpoint checkpoint;
  checkpoint.passes = decoder.get<uint32_t>();
  checkpoint.samples = decoder.get<uint32_t>();
  checkpoint.rays = decoder.get<uint64_t>();
  checkpoint.invalid_samples = decoder.get<uint64_t>();
  checkpoint.render_seconds = decoder.get<double>();
  checkpoint.cpu_seconds = decoder.get<double>();
  checkpoint.history.resize(decoder.get_count(sizeof(double)));
  for (HistoryEntry& entry : checkpoint.history) entry = get_history_entry(decoder);
  checkpoint.progression = get_progression(decoder);
  CachedLayers layers;
  if (decoder.get<uint8_t>() != 0) checkpoint.stage = get_stage(decoder, layers);
  checkpoint.tiles.resize(decoder.get_count(3 * sizeof(uint64_t)));
  for (auto& tile : checkpoint.tiles) {
    auto film = std::make_shared<TileFilm>();
    film->passes = checkpoint.passes;
    film->samples = checkpoint.samples;
    film->sampled = get_layer(decoder);
    film->narrow = get_layer(decoder);
    film->cached = get_layer(decoder);
    film->first_cached_sample = layers.first_sample;
    film->cached_samples = layers.samples;
    tile = std::move(film);
  }
  if (!decoder.at_end()) damaged("it is longer than it says");
  return checkpoint;
}

}  // namespace fogbank::render
