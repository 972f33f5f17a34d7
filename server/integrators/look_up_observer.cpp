#include "integrators/look_up_observer.h"

namespace fogbank::integrators {

std::vector<cache::Contribution> contributions_to(const LookUp& look_up, const cache::Index& index) {
  std::vector<cache::Contribution> result = index.contributions(look_up.place.position, look_up.place.normal);
  if (result.empty() && look_up.visibility != nullptr)
    result = index.recovered(look_up.place.position, look_up.place.normal, *look_up.visibility);
  return result;
}

}  // namespace fogbank::integrators
