// How far an image is from what it should be: as estimated from itself and its cache, and as a reference
// image tells.
#pragma once

#include <memory>
#include <vector>

#include "render/cache_survey.h"
#include "render/film.h"
#include "render/progress.h"
#include "render/render_settings.h"
#include "render/tiles.h"

namespace fogbank::render {

/// The films of all tiles of a finished pass, as one image.
struct PassImage {
  const TileGrid& grid;
  const std::vector<const TileFilm*>& tiles;

  /// Of the pixel in row `y`, column `x` of the crop window.
  Vec3d mean(int32_t x, int32_t y) const;
};

/// Root mean square over the survey's pixels, without the largest 0.1 %, of sqrt(bias^2 + variance) / (L + M
/// / 10): L the mean luminance of the 5 x 5 pixels around (as the survey's errors are means over look-ups,
/// while a pixel's own luminance is noisy at first), M that of the image. The noise of records is bias here:
/// it stays however many samples a pixel takes. `survey` has the channels variance and bias, in this order. 0
/// for a black image.
double relative_bias(const PassImage& image, const scene::Window& crop, const CacheSurvey& survey);

/// Denominators are computed once.
class ReferenceComparison {
 public:
  explicit ReferenceComparison(std::shared_ptr<const ReferenceImage> reference);

  TrueError compare(const PassImage& image) const;

 private:
  std::shared_ptr<const ReferenceImage> reference_;
  double mean_luminance_ = 0;
  std::vector<float> scales_;  ///< 1 / (m^2 + 0.01), as TrueError says; shape of the reference
};

}  // namespace fogbank::render
