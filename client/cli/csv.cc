#include "client/cli/csv.h"

#include <initializer_list>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "client/cli/format.h"

namespace orbitune::cli {
namespace {

void AppendDoubles(std::initializer_list<double> values, std::string* row) {
  for (const double value : values) absl::StrAppend(row, ",", RoundTrip(value));
}

}  // namespace

std::string IterationCsvHeader() {
  return "iteration,cost,settling_samples,fuel_sum,outcome,k1,k2,k3,k4,k5,cost_std,pairs_left_out,pairs_not_settled,"
         "episodes";
}

std::string IterationCsvRow(const v1::Iteration& iteration) {
  const std::string outcome = v1::Outcome_Name(iteration.outcome());
  std::string row = absl::StrCat(iteration.iteration(), ",", iteration.has_cost() ? RoundTrip(iteration.cost()) : "",
                                 ",", iteration.settling_samples(), ",", RoundTrip(iteration.fuel_sum()), ",",
                                 absl::StripPrefix(outcome, "OUTCOME_"));
  const v1::Gains& k = iteration.gains();
  AppendDoubles({k.k1(), k.k2(), k.k3(), k.k4(), k.k5(), iteration.cost_std()}, &row);
  absl::StrAppend(&row, ",", iteration.pairs_left_out(), ",", iteration.pairs_not_settled(), ",", iteration.episodes());
  return row;
}

std::string TrajectoryCsvHeader() {
  return "sample,time_s,p_km,ex,ey,hx,hy,true_longitude_deg,x1,x2,x3,x4,x5,x6,"
         "u_radial_m_s2,u_transverse_m_s2,u_normal_m_s2,lyapunov,distance_km";
}

std::string TrajectoryCsvRow(const v1::TrajectorySample& sample) {
  std::string row = absl::StrCat(sample.sample());
  const v1::EquinoctialElements& e = sample.chaser();
  const v1::ErrorCoordinates& x = sample.error();
  const v1::Control& u = sample.control();
  AppendDoubles({sample.time_s(), e.p_km(), e.ex(), e.ey(), e.hx(), e.hy(), e.true_longitude_deg()}, &row);
  AppendDoubles({x.x1(), x.x2(), x.x3(), x.x4(), x.x5(), x.x6()}, &row);
  AppendDoubles({u.radial_m_s2(), u.transverse_m_s2(), u.normal_m_s2(), sample.lyapunov(), sample.distance_km()}, &row);
  return row;
}

}  // namespace orbitune::cli
