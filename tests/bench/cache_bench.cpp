// Look-ups a second of the radiance cache, the time to publish an epoch, to extend a set and to write and
// read it, against the number of records. Fills thin records out: `filled` has 3 at a point, which is more
// than fills leave; `uniform` and `sheets` have 12. Run with --benchmark_filter=.../1000000 for a size.
// Counters: records that count at a point, bytes a record of set and index together, bytes a record in a
// file.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <filesystem>

#include "../unit/cache/record_clouds.h"
#include "../unit/cache/temporary_folder.h"
#include "cache/index.h"
#include "cache/store/store.h"
#include "core/sha256.h"

namespace fogbank::cache {
namespace {

double overlap(test::Layout layout) { return layout == test::Layout::filled ? 3 : 12; }

struct Cloud {
  std::shared_ptr<const RecordSet> set;
  std::unique_ptr<Epoch> epoch;
};

/// The last one made is kept: benchmarks of a size follow each other.
const Cloud& cloud(test::Layout layout, size_t count) {
  static Cloud last;
  static test::Layout last_layout{};
  static size_t last_count = 0;
  if (count != last_count || layout != last_layout) {
    last = {};
    last.set = std::make_shared<RecordSet>(test::make_cloud(layout, count, overlap(layout), 7));
    last.epoch = std::make_unique<Epoch>(last.set, test::cloud_settings());
    last_layout = layout;
    last_count = count;
  }
  return last;
}

/// Points of the unit cube: independent ones, or those of rays through 256 x 256 pixels, 64 along each, by
/// blocks of 4 x 2 pixels at the same distance, as a camera pass takes them.
std::vector<Vec3f> points(bool along_rays) {
  std::vector<Vec3f> result;
  RandomStream random(3, 0, 0, 0);
  for (uint32_t block = 0; block < 256; ++block) {
    for (uint32_t step = 0; step < 64; ++step) {
      for (uint32_t pixel = 0; pixel < 8; ++pixel) {
        const uint32_t column = 100 + block % 16 * 4 + pixel % 4;
        const uint32_t row = 100 + block / 16 * 2 + pixel / 4;
        const Vec3f direction((static_cast<float>(column) + 0.5f) / 256 - 0.5f,
                              (static_cast<float>(row) + 0.5f) / 256 - 0.5f, 1);
        const float distance = 0.2f + (static_cast<float>(step) + 0.5f) / 64;
        if (along_rays)
          result.push_back(Vec3f(0.5f, 0.5f, -0.2f) + distance * direction);
        else
          result.emplace_back(random.next_float(), random.next_float(), random.next_float());
      }
    }
  }
  return result;
}

void look_up(benchmark::State& state, test::Layout layout, bool along_rays) {
  const Cloud& records = cloud(layout, static_cast<size_t>(state.range(0)));
  const Index& index = *records.epoch->find({});
  const std::vector<Vec3f> where = points(along_rays);
  std::array<Interpolation, packet_size> results;
  size_t first = 0;
  double used = 0;
  for (auto _ : state) {
    index.look_up(std::span(where).subspan(first, packet_size), results);
    first = (first + packet_size) % where.size();
    used += results[0].records;
  }
  state.SetItemsProcessed(static_cast<int64_t>(state.iterations() * packet_size));
  state.counters["records"] = used / static_cast<double>(state.iterations());
  state.counters["bytes"] =
      static_cast<double>(records.epoch->memory()) / static_cast<double>(records.set->size());
}

void publish(benchmark::State& state, test::Layout layout) {
  const Cloud& records = cloud(layout, static_cast<size_t>(state.range(0)));
  for (auto _ : state) {
    const Epoch epoch(records.set, test::cloud_settings());
    benchmark::DoNotOptimize(epoch.find({}));
  }
  state.SetItemsProcessed(static_cast<int64_t>(state.iterations() * records.set->size()));
}

/// A set of which one record in a hundred is new: as a union with what was there, or from all records.
void extend(benchmark::State& state, bool rebuild) {
  const Cloud& records = cloud(test::Layout::uniform, static_cast<size_t>(state.range(0)));
  std::vector<Record> all;
  std::vector<Record> old;
  std::vector<Record> added;
  for (size_t i = 0; i < records.set->size(); ++i) {
    const Record record = records.set->record(i);
    if (rebuild)
      all.push_back(record);
    else
      (i % 100 == 50 ? added : old).push_back(record);
  }
  // New records come as fills make them, not in a set's order.
  std::ranges::sort(rebuild ? all : added, {}, &Record::id);
  const RecordSet before(std::move(old));
  for (auto _ : state) {
    const RecordSet result = rebuild ? RecordSet(all) : merge(before, RecordSet(added));
    benchmark::DoNotOptimize(result.shading());
  }
  state.SetItemsProcessed(static_cast<int64_t>(state.iterations() * records.set->size()));
}

const std::string transport = sha256("cache_bench");

void append(benchmark::State& state) {
  const Cloud& records = cloud(test::Layout::uniform, static_cast<size_t>(state.range(0)));
  for (auto _ : state) {
    const test::TemporaryFolder folder;
    StoredCache(folder.path() / transport, transport).append(*records.set, {});
  }
  state.SetItemsProcessed(static_cast<int64_t>(state.iterations() * records.set->size()));
}

void load(benchmark::State& state) {
  const Cloud& records = cloud(test::Layout::uniform, static_cast<size_t>(state.range(0)));
  const test::TemporaryFolder folder;
  StoredCache stored(folder.path() / transport, transport);
  stored.append(*records.set, {});
  uint64_t bytes = 0;
  for (auto _ : state) bytes += stored.load({}).bytes;
  state.SetItemsProcessed(static_cast<int64_t>(state.iterations() * records.set->size()));
  state.SetBytesProcessed(static_cast<int64_t>(bytes));
  state.counters["file_bytes"] =
      static_cast<double>(bytes) / static_cast<double>(state.iterations() * records.set->size());
}

// Sets of 10^7 records are made once, for benchmarks of one layout: they take a minute and 4 GB.
BENCHMARK_CAPTURE(look_up, sheets_rays, test::Layout::sheets, true)
    ->RangeMultiplier(10)
    ->Range(1000, 1000000);
BENCHMARK_CAPTURE(look_up, sheets_random, test::Layout::sheets, false)
    ->RangeMultiplier(10)
    ->Range(1000, 1000000);
BENCHMARK_CAPTURE(publish, sheets, test::Layout::sheets)->Arg(100000)->UseRealTime()->MeasureProcessCPUTime();

const int registered = [] {
  for (int64_t count = 1000; count <= 10000000; count *= 10) {
    benchmark::RegisterBenchmark("look_up/filled_rays", look_up, test::Layout::filled, true)->Arg(count);
    benchmark::RegisterBenchmark("look_up/filled_random", look_up, test::Layout::filled, false)->Arg(count);
    benchmark::RegisterBenchmark("publish/filled", publish, test::Layout::filled)
        ->Arg(count)
        ->UseRealTime()
        ->MeasureProcessCPUTime();
    benchmark::RegisterBenchmark("look_up/uniform_rays", look_up, test::Layout::uniform, true)->Arg(count);
    benchmark::RegisterBenchmark("look_up/uniform_random", look_up, test::Layout::uniform, false)->Arg(count);
    benchmark::RegisterBenchmark("publish/uniform", publish, test::Layout::uniform)
        ->Arg(count)
        ->UseRealTime()
        ->MeasureProcessCPUTime();
    for (const bool rebuild : {false, true})
      benchmark::RegisterBenchmark(rebuild ? "rebuild" : "extend", extend, rebuild)
          ->Arg(count)
          ->UseRealTime()
          ->MeasureProcessCPUTime();
    benchmark::RegisterBenchmark("append", append)->Arg(count)->UseRealTime()->MeasureProcessCPUTime();
    benchmark::RegisterBenchmark("load", load)->Arg(count)->UseRealTime()->MeasureProcessCPUTime();
  }
  return 0;
}();

}  // namespace
}  // namespace fogbank::cache

BENCHMARK_MAIN();
