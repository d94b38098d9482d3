#include "server/convert/distribution.h"

namespace orbitune {
namespace {

Variate FromProto(const v1::Variate& v) {
  switch (v.kind_case()) {
    case v1::Variate::kUniform:
      return UniformVariate{.low = v.uniform().low(), .high = v.uniform().high()};
    case v1::Variate::kNormal:
      return NormalVariate{.mean = v.normal().mean(), .standard_deviation = v.normal().standard_deviation()};
    case v1::Variate::kFixed:
    case v1::Variate::KIND_NOT_SET:
      break;
  }
  return FixedValue{v.fixed()};
}

void Set(const FixedValue& v, v1::Variate* out) { out->set_fixed(v.value); }
void Set(const UniformVariate& v, v1::Variate* out) {
  out->mutable_uniform()->set_low(v.low);
  out->mutable_uniform()->set_high(v.high);
}
void Set(const NormalVariate& v, v1::Variate* out) {
  out->mutable_normal()->set_mean(v.mean);
  out->mutable_normal()->set_standard_deviation(v.standard_deviation);
}

void ToProto(const Variate& variate, v1::Variate* out) {
  std::visit([out](const auto& v) { Set(v, out); }, variate);
}

}  // namespace

IcDistribution FromProto(const v1::IcDistribution& distribution) {
  if (distribution.has_keplerian()) {
    const v1::KeplerianDistribution& k = distribution.keplerian();
    const bool longitude = k.has_true_longitude_deg();
    return KeplerianDistribution{
        .semi_major_axis_km = FromProto(k.semi_major_axis_km()),
        .eccentricity = FromProto(k.eccentricity()),
        .inclination_deg = FromProto(k.inclination_deg()),
        .raan_deg = FromProto(k.raan_deg()),
        .argument_of_periapsis_deg = FromProto(k.argument_of_periapsis_deg()),
        .position = longitude ? KeplerianState::Position::kTrueLongitude : KeplerianState::Position::kTrueAnomaly,
        .position_deg = FromProto(longitude ? k.true_longitude_deg() : k.true_anomaly_deg()),
        .mirrored_periapsis = k.mirrored_periapsis()};
  }
  if (!distribution.has_equinoctial()) return std::monostate();
  const v1::EquinoctialDistribution& m = distribution.equinoctial();
  return EquinoctialDistribution{.p_km = FromProto(m.p_km()),
                                 .ex = FromProto(m.ex()),
                                 .ey = FromProto(m.ey()),
                                 .hx = FromProto(m.hx()),
                                 .hy = FromProto(m.hy()),
                                 .true_longitude_deg = FromProto(m.true_longitude_deg())};
}

void ToProto(const IcDistribution& distribution, v1::IcDistribution* out) {
  if (const auto* d = std::get_if<KeplerianDistribution>(&distribution)) {
    v1::KeplerianDistribution* k = out->mutable_keplerian();
    ToProto(d->semi_major_axis_km, k->mutable_semi_major_axis_km());
    ToProto(d->eccentricity, k->mutable_eccentricity());
    ToProto(d->inclination_deg, k->mutable_inclination_deg());
    ToProto(d->raan_deg, k->mutable_raan_deg());
    ToProto(d->argument_of_periapsis_deg, k->mutable_argument_of_periapsis_deg());
    const bool longitude = d->position == KeplerianState::Position::kTrueLongitude;
    ToProto(d->position_deg, longitude ? k->mutable_true_longitude_deg() : k->mutable_true_anomaly_deg());
    k->set_mirrored_periapsis(d->mirrored_periapsis);
  } else if (const auto* e = std::get_if<EquinoctialDistribution>(&distribution)) {
    v1::EquinoctialDistribution* m = out->mutable_equinoctial();
    ToProto(e->p_km, m->mutable_p_km());
    ToProto(e->ex, m->mutable_ex());
    ToProto(e->ey, m->mutable_ey());
    ToProto(e->hx, m->mutable_hx());
    ToProto(e->hy, m->mutable_hy());
    ToProto(e->true_longitude_deg, m->mutable_true_longitude_deg());
  }
}

}  // namespace orbitune
