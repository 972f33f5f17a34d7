// One function per BSDF plugin, for bsdf_registry.cpp. Each reads its parameters and leaves `finish` to the
// builder; what it throws for wrong parameters stands at the head of its file.
#pragma once

#include "transport/bsdf.h"

namespace fogbank::transport {

BsdfPointer make_blend(scene::PropertyReader& reader, BsdfBuilder& builder);
BsdfPointer make_bump_map(scene::PropertyReader& reader, BsdfBuilder& builder);
BsdfPointer make_conductor(scene::PropertyReader& reader, BsdfBuilder& builder);
BsdfPointer make_dielectric(scene::PropertyReader& reader, BsdfBuilder& builder);
BsdfPointer make_diffuse(scene::PropertyReader& reader, BsdfBuilder& builder);
BsdfPointer make_mask(scene::PropertyReader& reader, BsdfBuilder& builder);
BsdfPointer make_normal_map(scene::PropertyReader& reader, BsdfBuilder& builder);
BsdfPointer make_null(scene::PropertyReader& reader, BsdfBuilder& builder);
BsdfPointer make_plastic(scene::PropertyReader& reader, BsdfBuilder& builder);
BsdfPointer make_principled(scene::PropertyReader& reader, BsdfBuilder& builder);
BsdfPointer make_rough_conductor(scene::PropertyReader& reader, BsdfBuilder& builder);
BsdfPointer make_rough_dielectric(scene::PropertyReader& reader, BsdfBuilder& builder);
BsdfPointer make_rough_plastic(scene::PropertyReader& reader, BsdfBuilder& builder);
BsdfPointer make_thin_dielectric(scene::PropertyReader& reader, BsdfBuilder& builder);
BsdfPointer make_two_sided(scene::PropertyReader& reader, BsdfBuilder& builder);

}  // namespace fogbank::transport
