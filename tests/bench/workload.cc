#include "tests/bench/workload.h"

#include <cmath>

#include "core/base/check.h"
#include "core/base/random.h"
#include "core/scenario/presets.h"

namespace orbitune::bench {
namespace {

// A rendezvous on an ellipse of e = 0.29.
Scenario Elliptic() {
  Scenario s;
  s.id = "elliptic";
  s.target = EquinoctialState{
      .p_km = 12470.69, .ex = 0.2797, .ey = 0.0645, .hx = 0.1416, .hy = 0.1437, .true_longitude_deg = 42.02};
  s.chaser = EquinoctialState{
      .p_km = 12403.53, .ex = 0.2884, .ey = 0.0705, .hx = 0.1470, .hy = 0.1193, .true_longitude_deg = 37.15};
  s.sampling_period_s = 300;
  s.horizon_samples = 1280;
  s.fuel_weight = 100;
  s.settling_distance_km = 2;
  return s;
}

struct Point {
  const char* suffix;
  Gains centre;
};

Workload Scatter(const Scenario& scenario, const Point& point, int count, double tolerance) {
  Workload w{.name = scenario.id + "/" + point.suffix};
  auto prepared = Prepare(scenario);
  ORBITUNE_CHECK(prepared.ok());
  w.problem = prepared->problem;
  w.problem.tolerance = tolerance;
  for (int j = 0; j < count; ++j) {
    Gains k = point.centre;
    const RandomKey key{
        .seed = 1, .stream = RandomStream::kSearchDirections, .a = 1, .b = static_cast<std::uint32_t>(j)};
    for (std::uint32_t i = 0; i < kGainCount; ++i) k[i] *= std::exp(0.05 * StandardNormal(key, i));
    w.gains.push_back(k);
  }
  return w;
}

}  // namespace

std::vector<Workload> MakeWorkloads(int count, double tolerance) {
  std::vector<Workload> workloads;
  const Scenario elliptic = Elliptic();
  const struct {
    const Scenario* scenario;
    Gains tuned;  // where the search ends, rounded
  } kinds[] = {{FindPreset("gto-geo"), {0.7, 0.2, 0.8, 0.75, 3}},
               {FindPreset("leo-rendezvous"), {1.2, 1, 0.7, 1.2, 0.8}},
               {&elliptic, {1.2, 0.9, 0.8, 0.5, 2.6}}};
  for (const auto& [scenario, tuned] : kinds) {
    workloads.push_back(Scatter(*scenario, {"initial", scenario->search.initial_gains}, count, tolerance));
    workloads.push_back(Scatter(*scenario, {"tuned", tuned}, count, tolerance));
  }
  return workloads;
}

}  // namespace orbitune::bench
