#include "tests/storage/store_support.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdlib>
#include <future>
#include <limits>
#include <memory>

#include "absl/strings/str_cat.h"
#include "core/library/scenario_digest.h"
#include "core/scenario/presets.h"
#include "storage/serialise.h"

namespace orbitune::storage_test {
namespace {

using std::string_literals::operator""s;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kTiny = std::numeric_limits<double>::denorm_min();

template <typename Result, typename Call>
Result WaitFor(const Call& call) {
  auto answer = std::make_shared<std::promise<Result>>();
  auto future = answer->get_future();
  call([answer](Result result) { answer->set_value(std::move(result)); });
  return future.get();
}

std::string DifferentRecords(std::string_view name, const std::optional<IterationRecord>& a,
                             const std::optional<IterationRecord>& b) {
  if (a.has_value() == b.has_value() && (!a || Identical(*a, *b))) return "";
  return absl::StrCat(ToAbsl(name), " differs; ");
}

}  // namespace

TemporaryDirectory::TemporaryDirectory(const std::filesystem::path& parent) {
  std::string name = (parent / "orbitune-storage-XXXXXX").string();
  path_ = mkdtemp(name.data());
}

TemporaryDirectory::~TemporaryDirectory() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

JobSpec PlainSpec(const std::string& display_name) {
  JobSpec spec;
  spec.display_name = display_name;
  spec.scenario = *FindPreset("leo-rendezvous");
  spec.initial_condition = spec.scenario.chaser;
  return spec;
}

JobSpec OddSpec() {
  JobSpec spec;
  spec.display_name = "it's a \"job\"\n\t\\ \xF0\x9F\x9B\xB0 \xC3\xBC\0 after a NUL"s;
  spec.labels = {{"", ""}, {"team", "o'rbit; DROP TABLE jobs"}, {"\xC3\xA9t\xC3\xA9", "%_\\"}};
  Scenario& s = spec.scenario;
  s.id = "its own";
  s.display_name = "odd";
  s.description = std::string(10'000, 'x');
  s.gravitational_parameter_km3_s2 = 0.1 + 0.2;
  s.target = EquinoctialState{
      .p_km = 1.0 / 3, .ex = -0.0, .ey = kTiny, .hx = 1e-300, .hy = -1e300, .true_longitude_deg = 1e22};
  s.chaser = CartesianStateKm{.x_km = kInfinity,
                              .y_km = -kInfinity,
                              .z_km = kNan,
                              .x_dot_km_s = 5e-324,
                              .y_dot_km_s = std::nextafter(1.0, 2.0),
                              .z_dot_km_s = 1.7976931348623157e308};
  s.sampling_period_s = std::nextafter(60.0, 0.0);
  s.horizon_samples = std::numeric_limits<int>::max();
  s.fuel_weight = 1e-7;
  s.settling_distance_km = 123456789.123456789;
  s.velocity_unit_m_s = 9007199254740993.0;
  s.acceleration_unit_m_s2 = 0.007;
  s.control_hold = ControlHold::kZeroOrder;
  s.integration_tolerance = 1e-11;
  s.search = {.iterations = -5,
              .step_size = 0.1,
              .exploration_scale = 0.7,
              .directions = 3,
              .initial_gains = {0.1, 0.2, 0.3, 1e-3, kNan},
              .exploration_std = {-0.0, 1, 2, 3, 4},
              .gain_floor = 2e-3,
              .seed = std::numeric_limits<std::uint64_t>::max(),
              .algorithm = Algorithm::kNelderMead,
              .max_episodes = 9'007'199'254'740'993,
              .plateau_stop = {.iterations = 7, .min_improvement = 0.1},
              .ars_variants = {.top_directions = 2,
                               .step_schedule = Schedule::kLinear,
                               .exploration_schedule = Schedule::kInverseSqrt,
                               .log_gains = true},
              .cma_es = {.population = 9, .initial_sigma = 0.3, .restarts = 4, .population_growth = 2.5},
              .nelder_mead = {.initial_step = 0.9, .restarts = 6}};
  spec.initial_condition = KeplerianState{.semi_major_axis_km = 7378.137,
                                          .eccentricity = 0.1,
                                          .inclination_deg = 81.3,
                                          .raan_deg = -12.7,
                                          .argument_of_periapsis_deg = 359.9,
                                          .position = KeplerianState::Position::kTrueLongitude,
                                          .position_deg = 45.1};
  spec.initial_conditions = {spec.initial_condition, s.target, std::monostate()};
  spec.objective = {.aggregate = Aggregate::kCvar, .level = 0.9, .relative_to_initial = true};
  spec.warm_start = "jobs/another";
  spec.campaign_id = "campaign";
  spec.owner = "ana";
  return spec;
}

JobReport OddReport() {
  JobReport report;
  report.initial = {.iteration = 1, .gains = {0.1, 1, 1, 1, 10}, .episode = {}};
  report.initial.episode.outcome_message = "left the domain after 3.7 h";
  report.final = {.iteration = 5000, .gains = {0.3, 1.0 / 3, -0.0, 2, 1e-3}, .episode = {}};
  report.final.episode = {.outcome = Outcome::kSettled,
                          .outcome_message = "",
                          .end_time_s = 1e6 / 7,
                          .cost = 123.456,
                          .settling_samples = 77,
                          .settling_time_s = 7e4 / 9,
                          .fuel_sum = 0.1,
                          .delta_v_to_settling_m_s = 55.5 / 3,
                          .delta_v_horizon_m_s = kInfinity,
                          .peak_acceleration_m_s2 = 1e-5 / 3,
                          .initial_lyapunov = 0.2,
                          .domain_guaranteed = true};
  report.best = report.final;
  report.best.iteration = 4321;
  report.best.episode.outcome = Outcome::kNotSettled;
  report.best.ensemble = EnsembleReport{.initial_conditions = 50,
                                        .settled = 49,
                                        .objective = 0.1 + 0.2,
                                        .cost = {1.0 / 3, -0.0, kInfinity},
                                        .cost_reduction_percent = {1, kNan, 3},
                                        .settling_time_reduction_percent = {},
                                        .fuel_sum_reduction_percent = {4, 5, 6}};
  report.warnings = {{WarningKind::kPairsLeftOut, "3 \"pairs\""}, {WarningKind::kGainAtFloor, "K5 \xE2\x89\xA4 1e-3"}};
  report.episodes = 9'007'199'254'740'993;
  return report;
}

GainSet OddGainSet(const std::string& id) {
  GainSet set;
  set.id = id;
  set.kind = GainSetKind::kImported;
  set.display_name = "it's \"good\"\n\xC3\xBC\0 after a NUL"s;
  set.create_time_us = 1'700'000'000'000'001;
  set.gains = {-0.0, kTiny, 0.1 + 0.2, 1.7976931348623157e308, kNan};
  set.velocity_unit_m_s = 1.0 / 3;
  set.acceleration_unit_m_s2 = 21.966739520234142;
  set.scenario = LibraryDefinition(*FindPreset("gto-geo"));
  set.scenario.id = "its own";
  set.scenario_digest = ScenarioDigest(set.scenario);
  set.initial_condition = KeplerianState{.semi_major_axis_km = 24364.1, .eccentricity = 0.73, .position_deg = 1e-7};
  set.initial_error = ErrorState{0.1, -0.0, 1e-300, kTiny, -5, 1.0 / 7};
  set.job_id = "job o'id";
  set.campaign_id = "campaign";
  set.iteration = 4321;
  set.algorithm = "CMA_ES";
  set.seed = std::numeric_limits<std::uint64_t>::max();
  set.engine_version = "0.1.0";
  set.origin = "gainSets/there";
  set.flight = {.outcome = Outcome::kNotSettled,
                .outcome_message = "not settled",
                .cost = 123.456,
                .settling_samples = 1280,
                .settling_time_s = 7e4 / 9,
                .fuel_sum = 0.1,
                .delta_v_m_s = 55.5 / 3,
                .peak_acceleration_m_s2 = kNan,
                .certificate = {.gains_positive = true, .lyapunov_decreasing = true}};
  return set;
}

GainSet PlainGainSet(const std::string& id, std::int64_t create_time_us) {
  GainSet set;
  set.id = id;
  set.create_time_us = create_time_us;
  set.gains = {0.1, 1, 1, 1, 10};
  set.scenario = LibraryDefinition(*FindPreset("leo-rendezvous"));
  set.scenario_digest = ScenarioDigest(set.scenario);
  set.initial_condition = FindPreset("leo-rendezvous")->chaser;
  set.initial_error = ErrorState{.x1 = 0.01};
  return set;
}

IterationRecord RecordOf(int iteration) {
  IterationRecord record{
      .iteration = iteration,
      .gains = {0.1 + 1e-3 / iteration, std::sqrt(iteration), 1.0 / iteration, -0.0, std::log(1.0 + iteration)},
      .outcome = static_cast<Outcome>(iteration % 2),
      .cost = 1000.0 + 1000.0 / iteration + std::sin(iteration),
      .settling_samples = iteration % 1280,
      .fuel_sum = 0.1 * iteration,
      .cost_std = std::exp(-iteration / 1000.0),
      .pairs_left_out = iteration % 3,
      .pairs_not_settled = iteration % 5,
      .episodes = 33'000'000'000 * iteration};
  if (iteration % 7 == 3) {
    record.outcome = Outcome::kLeftDomain;
    record.cost = record.fuel_sum = kNan;
  }
  return record;
}

IterationRecord RecordWith(int iteration, Outcome outcome, double cost) {
  IterationRecord record = RecordOf(iteration);
  record.outcome = outcome;
  record.cost = cost;
  return record;
}

StateChange ChangeTo(JobState state, TimeUs time_us, std::string message) {
  return {.state = state, .time_us = time_us, .message = std::move(message), .report = {}};
}

absl::StatusOr<JobRecord> Create(JobStore& store, const std::string& id, const JobSpec& spec, TimeUs now,
                                 const std::string& request_id, const std::string& digest) {
  return WaitFor<absl::StatusOr<JobRecord>>(
      [&](JobStore::Created done) { store.CreateJob(id, spec, now, request_id, digest, std::move(done)); });
}

absl::Status Append(JobStore& store, const std::string& id, std::int64_t seq, const IterationRecord& record) {
  return WaitFor<absl::Status>(
      [&](JobStore::Done done) { store.AppendIteration(id, seq, record, {}, std::move(done)); });
}

absl::Status Change(JobStore& store, const std::string& id, std::int64_t seq, const StateChange& change) {
  return WaitFor<absl::Status>([&](JobStore::Done done) { store.ChangeState(id, seq, change, std::move(done)); });
}

absl::Status Delete(JobStore& store, const std::string& id) {
  return WaitFor<absl::Status>([&](JobStore::Done done) { store.DeleteJob(id, std::move(done)); });
}

absl::Status AddGainSets(JobStore& store, const std::vector<GainSet>& sets) {
  return WaitFor<absl::Status>([&](GainStore::Done done) { store.gains().AddGainSets(sets, std::move(done)); });
}

absl::Status DeleteGainSet(JobStore& store, const std::string& id) {
  return WaitFor<absl::Status>([&](GainStore::Done done) { store.gains().DeleteGainSet(id, std::move(done)); });
}

void CreateWithIterations(JobStore& store, const std::string& id, int n) {
  ASSERT_TRUE(Create(store, id).ok());
  for (int i = 1; i <= n; ++i) {
    store.AppendIteration(id, i + 1, RecordOf(i), {},
                          [](const absl::Status& status) { EXPECT_TRUE(status.ok()) << status; });
  }
  store.Flush();
}

std::string Difference(const JobSpec& a, const JobSpec& b) {
  const auto a_json = ToJson(a);
  const auto b_json = ToJson(b);
  return a_json.ok() && b_json.ok() && *a_json == *b_json ? "" : "spec differs; ";
}

std::string Difference(const JobReport& a, const JobReport& b) {
  return ToJson(a) == ToJson(b) ? "" : "report differs; ";
}

std::string Difference(const JobEvent& a, const JobEvent& b) {
  if (a.seq != b.seq) return absl::StrCat("event ", a.seq, " for ", b.seq, "; ");
  if (a.what.index() != b.what.index()) return absl::StrCat("event ", a.seq, " is of another kind; ");
  if (const auto* record = std::get_if<IterationRecord>(&a.what)) {
    return Identical(*record, std::get<IterationRecord>(b.what)) ? "" : absl::StrCat("event ", a.seq, " differs; ");
  }
  const auto& x = std::get<StateChange>(a.what);
  const auto& y = std::get<StateChange>(b.what);
  const bool same = x.state == y.state && x.time_us == y.time_us && x.message == y.message &&
                    x.report.has_value() == y.report.has_value() &&
                    (!x.report || Difference(*x.report, *y.report).empty());
  return same ? "" : absl::StrCat("state change ", a.seq, " differs; ");
}

std::string Difference(const JobRecord& a, const JobRecord& b) {
  std::string difference = Difference(a.spec, b.spec);
  const auto compare = [&difference](std::string_view name, const auto& x, const auto& y) {
    if (x != y) absl::StrAppend(&difference, ToAbsl(name), ": ", x, " for ", y, "; ");
  };
  compare("id", a.id, b.id);
  compare("state", static_cast<int>(a.state), static_cast<int>(b.state));
  compare("create_time", a.create_time_us, b.create_time_us);
  compare("start_time", a.start_time_us, b.start_time_us);
  compare("end_time", a.end_time_us, b.end_time_us);
  compare("update_time", a.update_time_us, b.update_time_us);
  compare("last_seq", a.last_seq, b.last_seq);
  compare("state_changes", a.state_changes, b.state_changes);
  compare("error_message", a.error_message, b.error_message);
  compare("has report", a.report.has_value(), b.report.has_value());
  if (a.report && b.report) difference += Difference(*a.report, *b.report);
  compare("has provenance", a.provenance.has_value(), b.provenance.has_value());
  if (a.provenance && b.provenance) {
    compare("provenance", ToJson(*a.provenance), ToJson(*b.provenance));
    compare("digest", ToHex(a.provenance->digest), ToHex(b.provenance->digest));
  }
  difference += DifferentRecords("first", a.first, b.first);
  difference += DifferentRecords("latest", a.latest, b.latest);
  difference += DifferentRecords("best", a.best, b.best);
  return difference;
}

std::string Difference(const GainSet& a, const GainSet& b) {
  std::string difference = GainSetDocument(a) == GainSetDocument(b) ? "" : "document differs; ";
  if (ToJson(a.scenario) != ToJson(b.scenario)) difference += "scenario differs; ";
  const auto compare = [&difference](std::string_view name, const auto& x, const auto& y) {
    if (x != y) absl::StrAppend(&difference, ToAbsl(name), ": ", x, " for ", y, "; ");
  };
  compare("id", a.id, b.id);
  compare("kind", static_cast<int>(a.kind), static_cast<int>(b.kind));
  compare("create_time", a.create_time_us, b.create_time_us);
  compare("digest", a.scenario_digest, b.scenario_digest);
  compare("job", a.job_id, b.job_id);
  compare("campaign", a.campaign_id, b.campaign_id);
  compare("located", a.initial_error.has_value(), b.initial_error.has_value());
  const auto bits = [](double value) { return std::isnan(value) ? 0 : std::bit_cast<std::uint64_t>(value); };
  for (std::size_t i = 0; i < kGainCount; ++i) compare("gain", bits(a.gains[i]), bits(b.gains[i]));
  if (!a.initial_error || !b.initial_error) return difference;
  const auto& x = *a.initial_error;
  const auto& y = *b.initial_error;
  compare("x1", bits(x.x1), bits(y.x1));
  compare("x2", bits(x.x2), bits(y.x2));
  compare("x3", bits(x.x3), bits(y.x3));
  compare("x4", bits(x.x4), bits(y.x4));
  compare("x5", bits(x.x5), bits(y.x5));
  compare("x6", bits(x.x6), bits(y.x6));
  return difference;
}

}  // namespace orbitune::storage_test
