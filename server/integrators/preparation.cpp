#include "core/error.h"
#include "integrators/integrator.h"

namespace fogbank::integrators {

namespace {

[[noreturn]] void refuse() {
  throw Error(ErrorKind::unsupported, "NOT_SHARED", "the results of this preparation can't be shared");
}

}  // namespace

void Integrator::restore(const CameraRays& /*camera*/, std::string_view /*state*/) {
  throw Error(ErrorKind::unsupported, "NOT_RESTORED", "this integrator's preparations can't be restored");
}

std::string Preparation::result(uint32_t /*task*/) const { refuse(); }

void Preparation::accept(uint32_t /*task*/, std::string_view /*result*/) { refuse(); }

std::string Preparation::outcome() { refuse(); }

void Preparation::adopt(std::string_view /*outcome*/) { refuse(); }

}  // namespace fogbank::integrators
