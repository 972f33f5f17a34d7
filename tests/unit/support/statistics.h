// Statistical tests that unit tests share.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <vector>

namespace fogbank::test {

/// Regularised upper incomplete gamma function Q(a, x) for a > 0, x >= 0: by its series below a + 1 and
/// Lentz's continued fraction above (Abramowitz and Stegun, 6.5.29 and 6.5.31). Relative error about 1e-12.
inline double upper_gamma_q(double a, double x) {
  constexpr int max_terms = 10000;
  constexpr double tolerance = 1e-14;
  if (x <= 0) return 1.0;
  const double scale = std::exp(a * std::log(x) - x - std::lgamma(a));
  if (x < a + 1) {
    double term = 1.0 / a;
    double sum = term;
    for (int n = 1; n < max_terms && std::fabs(term) > tolerance * std::fabs(sum); ++n) {
      term *= x / (a + n);
      sum += term;
    }
    return 1.0 - scale * sum;
  }
  constexpr double tiny = std::numeric_limits<double>::min() * 1e10;
  double b = x + 1 - a;
  double c = 1.0 / tiny;
  double d = 1.0 / b;
  double fraction = d;
  for (int n = 1; n < max_terms; ++n) {
    const double numerator = -n * (n - a);
    b += 2;
    d = numerator * d + b;
    if (std::fabs(d) < tiny) d = tiny;
    c = b + numerator / c;
    if (std::fabs(c) < tiny) c = tiny;
    d = 1.0 / d;
    const double factor = c * d;
    fraction *= factor;
    if (std::fabs(factor - 1.0) < tolerance) break;
  }
  return scale * fraction;
}

/// Probability of a chi-squared statistic at least as large as `statistic`.
inline double chi_squared_p_value(double statistic, double degrees_of_freedom) {
  return upper_gamma_q(0.5 * degrees_of_freedom, 0.5 * statistic);
}

/// Pearson's chi-squared test of observed counts against expected ones; returns the p-value. Bins are pooled
/// in order of expected count until each holds at least 5, the usual condition for the chi-squared
/// approximation. A count in bins that together expect (almost) nothing gives 0. Expected counts must add up
/// to the observed total.
inline double chi_squared_test(const std::vector<double>& observed, const std::vector<double>& expected) {
  constexpr double least_expected = 5.0;
  std::vector<std::size_t> order(expected.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return expected[a] < expected[b]; });
  double statistic = 0;
  int bins = 0;
  double pooled_observed = 0;
  double pooled_expected = 0;
  for (const std::size_t i : order) {
    if (expected[i] <= 0) {
      if (observed[i] > 0) return 0.0;
      continue;
    }
    pooled_observed += observed[i];
    pooled_expected += expected[i];
    if (pooled_expected < least_expected) continue;
    const double difference = pooled_observed - pooled_expected;
    statistic += difference * difference / pooled_expected;
    ++bins;
    pooled_observed = 0;
    pooled_expected = 0;
  }
  if (bins < 2) return 1.0;
  return chi_squared_p_value(statistic, bins - 1);
}

/// Level of one of `tests` tests so that all of them together fail by chance with probability 1 % (Sidak
/// 1967). Tests here have fixed seeds, so they pass or fail for ever; the level only says how surprising a
/// failure is.
inline double significance_level(int tests) { return 1.0 - std::pow(0.99, 1.0 / tests); }

}  // namespace fogbank::test
