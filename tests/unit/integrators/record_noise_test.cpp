#include "integrators/record_noise.h"

#include <gtest/gtest.h>

namespace fogbank::integrators {
namespace {

constexpr cache::Component component{};

cache::Record record_at(const Vec3f& position, float variance) {
  cache::Record record;
  record.position = position;
  record.radiance = Spectrum(1);
  record.variance = variance;
  record.component = component;
  record.id = cache::content_id(position, component, "", 0);
  return record;
}

/// Records a unit apart, alike but for their variances.
cache::Epoch row_of(const std::vector<float>& variances) {
  std::vector<cache::Record> records;
  for (size_t i = 0; i < variances.size(); ++i)
    records.push_back(record_at(Vec3f(static_cast<float>(i), 0, 0), variances[i]));
  cache::MetricSettings settings;
  settings.threshold = 1;
  settings.radiance_floor = 1;
  settings.maximum_radius = 0.4;
  return {std::make_shared<const cache::RecordSet>(std::move(records)), settings};
}

void look(RecordNoise& noise, const cache::Epoch& epoch, float x, float weight) {
  const Vec3f place(x, 0, 0);
  noise.look_up({.place = {place, Vec3f(0), component},
                 .found = epoch.find(component)->look_up(place),
                 .weight = Spectrum(weight)});
}

std::vector<float> places(const RecordNoise& noise, const cache::Epoch& epoch, double error) {
  std::vector<float> result;
  for (const auto& [index, place] : noise.noisy(error))
    result.push_back(epoch.records().position(index->range(), place).x);
  return result;
}

TEST(RecordNoise, FindsTheRecordsThatMakeIt) {
  const cache::Epoch epoch = row_of({0.0001f, 0.09f, 0.0001f, 0.09f});
  RecordNoise noise(epoch);
  // Half of the light from the noisy second record: a deviation of 0.15 of 1.
  look(noise, epoch, 0, 0.5f);
  look(noise, epoch, 1.1f, 0.5f);
  noise.end_ray();
  // Hardly any from the fourth.
  look(noise, epoch, 2, 0.99f);
  look(noise, epoch, 3, 0.01f);
  noise.end_ray();
  // Tolerable is the error times light and a tenth of its mean: 0.1 * 1.1 and 0.15 * 1.1 lie about 0.15.
  EXPECT_EQ(places(noise, epoch, 0.1), std::vector<float>{1});
  EXPECT_EQ(places(noise, epoch, 0.15), std::vector<float>{});
}

TEST(RecordNoise, BandsAddUp) {
  const cache::Epoch epoch = row_of({0.09f, 0.09f});
  RecordNoise whole(epoch);
  RecordNoise first(epoch);
  RecordNoise second(epoch);
  for (RecordNoise* noise : {&whole, &first}) {
    look(*noise, epoch, 0, 1);
    noise->end_ray();
  }
  for (RecordNoise* noise : {&whole, &second}) {
    look(*noise, epoch, 1, 3);
    noise->end_ray();
  }
  first.append(std::move(second));
  EXPECT_EQ(places(first, epoch, 0.2), places(whole, epoch, 0.2));
  EXPECT_EQ(places(whole, epoch, 0.2).size(), 2u);
}

}  // namespace
}  // namespace fogbank::integrators
