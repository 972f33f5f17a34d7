#include "transport/rough_interface.h"

#include "transport/fresnel.h"

namespace fogbank::transport {

namespace {

/// Nodes of the quadrature over visible normals in each of its two dimensions: errors below 1e-3 (relative)
/// in the transmittance and 3e-4 (absolute) in the internal reflectance for alpha from 0.01 to 0.8 and eta
/// from 1.3 to 2.4, against 96 nodes. Some 5 ms altogether.
constexpr int node_count = 32;

/// A node of a quadrature over the normals that are visible from one direction; the weights of all sum to 1.
struct VisibleNormal {
  Vec3f m{0, 0, 1};
  float weight = 0;
};

/// Nodes and weights of Gauss-Legendre quadrature on [0, 1] (Newton's method on the Legendre polynomial from
/// the usual cosine estimate; Abramowitz and Stegun 25.4.29).
struct GaussLegendre {
  std::array<float, node_count> nodes{};
  std::array<float, node_count> weights{};

  GaussLegendre() {
    constexpr double n = node_count;
    for (size_t i = 0; i < node_count; ++i) {
      double x = std::cos(3.14159265358979323846 * (static_cast<double>(i) + 0.75) / (n + 0.5));
      double derivative = 0;
      for (int iteration = 0; iteration < 8; ++iteration) {
        double previous = 1;
        double value = x;
        for (int order = 2; order <= node_count; ++order) {
          const double next = ((2.0 * order - 1.0) * x * value - (order - 1.0) * previous) / order;
          previous = value;
          value = next;
        }
        derivative = n * (x * value - previous) / (x * x - 1.0);
        x -= value / derivative;
      }
      nodes[i] = static_cast<float>(0.5 * (1.0 - x));
      weights[i] = static_cast<float>(1.0 / ((1.0 - x * x) * derivative * derivative));
    }
  }
};

using VisibleNormals = std::array<VisibleNormal, static_cast<size_t>(node_count) * node_count>;

/// Quadrature over the normals visible from `wo` (in the x-z plane, which halves the work: both sides of it
/// are alike).
VisibleNormals visible_normals(MicrofacetType type, float alpha, const Vec3f& wo) {
  static const GaussLegendre rule;
  const MicrofacetDistribution facets(type, alpha, alpha);
  VisibleNormals normals;
  // Beckmann: Gaussian slopes of the surface stretched to roughness 1, weighted by the visible part of their
  // facets, over t = erf(slope). GGX: over the spherical cap that the sampling routine projects from.
  const float tangent = alpha * wo.x / wo.z;
  const float highest = std::erf(1.0f / std::fmax(tangent, 1e-6f));
  float total = 0;
  for (size_t i = 0; i < node_count; ++i) {
    for (size_t j = 0; j < node_count; ++j) {
      VisibleNormal& normal = normals[i * node_count + j];
      normal.weight = rule.weights[i] * rule.weights[j];
      if (type == MicrofacetType::beckmann) {
        const float x = inverse_erf(-1.0f + rule.nodes[i] * (1.0f + highest));
        const float y = inverse_erf(rule.nodes[j]);
        normal.weight *= std::fmax(0.0f, 1.0f - x * tangent);
        normal.m = glm::normalize(Vec3f(-alpha * x, alpha * y, 1.0f));
      } else {
        normal.m = facets.sample_visible_normal(wo, {0.5f * rule.nodes[i], rule.nodes[j]});
      }
      total += normal.weight;
    }
  }
  for (VisibleNormal& normal : normals) normal.weight /= total;
  return normals;
}

}  // namespace

RoughInterface::RoughInterface(MicrofacetType type, float alpha, float eta) {
  const MicrofacetDistribution facets(type, alpha, alpha);
  float internal = 0;
  for (size_t i = 0; i < size; ++i) {
    const float cosine = std::fmax(1e-6f, static_cast<float>(i) / static_cast<float>(size - 1));
    const Vec3f wo(safe_sqrt(1.0f - cosine * cosine), 0, cosine);
    for (const VisibleNormal& normal : visible_normals(type, alpha, wo)) {
      const float cos_o = glm::dot(wo, normal.m);
      const DielectricFresnel entering = fresnel_dielectric(cos_o, eta);
      const Vec3f refracted = refract(wo, normal.m, entering.cos_theta_t, entering.eta_ti);
      if (refracted.z < 0.0f)
        transmittance_[i] +=
            normal.weight * (1.0f - entering.reflectance) * facets.masking(refracted, normal.m);
      const Vec3f mirrored = reflect(wo, normal.m);
      if (mirrored.z > 0.0f)
        internal += normal.weight * cosine * fresnel_dielectric(cos_o, 1.0f / eta).reflectance *
                    facets.masking(mirrored, normal.m);
    }
    transmittance_[i] = std::fmin(1.0f, transmittance_[i]);  // the weights add up to 1 but for rounding
  }
  // A plain mean over the nodes, as Mitsuba 3 defines it: it weighs the end node fully and so falls 1.5 %
  // short of the integral, but the albedo of every `roughplastic` scene depends on it.
  internal_reflectance_ = 2.0f * internal / static_cast<float>(size);
}

}  // namespace fogbank::transport
