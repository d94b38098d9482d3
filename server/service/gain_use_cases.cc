#include "server/service/gain_use_cases.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <future>
#include <map>
#include <tuple>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/library/scenario_digest.h"
#include "core/simd/batch_simulator.h"
#include "server/jobs/gain_sets.h"
#include "server/service/list_filter.h"
#include "server/service/page_token.h"

namespace orbitune {
namespace {

// Faults named in one answer, of as many gain sets.
constexpr std::size_t kMostFaults = 20;

void CheckRange(FieldErrors& errors, std::string_view field, int value, int most, std::string_view zero_means) {
  if (value < 0 || value > most) {
    errors.AddNumber(field, absl::StrCat("in [0, ", most, "] (0: ", ToAbsl(zero_means), ")"), value);
  }
}

absl::Status Validate(const GainQuery& query) {
  FieldErrors errors;
  CheckRange(errors, "max_candidates", query.max_candidates, QueryOptions::kMostCandidates, "64");
  CheckRange(errors, "max_answers", query.max_answers, QueryOptions::kMostAnswers, "5");
  if (query.refine_budget_ms) {
    CheckRange(errors, "refine.budget_ms", *query.refine_budget_ms, GainUseCases::kMostRefineMs, "100");
  }
  return errors.ToStatus();
}

// The violations of a scenario where a request names it "scenario_definition".
absl::Status InRequest(const absl::Status& prepared) {
  FieldErrors errors;
  for (const FieldViolation& v : FieldViolationsOf(prepared)) {
    const bool of_start = v.field.starts_with("initial_condition");
    errors.AddViolation({absl::StrCat(of_start ? "" : "scenario_definition.", v.field), v.description});
  }
  return errors.empty() ? prepared : errors.ToStatus();
}

void FlyBatch(const EpisodeProblem& problem, std::span<const Gains> gains, std::span<EpisodeResult> results,
              const std::function<bool()>& cancelled) {
  std::vector<BatchEpisode> episodes;
  episodes.reserve(gains.size());
  for (const Gains& k : gains) episodes.push_back({.problem = &problem, .gains = k});
  SimulateBatch(episodes, results, cancelled);
}

std::string NamedScenario(const Scenario& scenario) {
  return scenario.id.empty() ? "this scenario" : absl::StrCat("scenarios/", scenario.id);
}

}  // namespace

// ---- queries

absl::StatusOr<GainQueryAnswer> GainUseCases::Query(const GainQuery& query, const std::function<bool()>& cancelled) {
  if (absl::Status status = Validate(query); !status.ok()) return status;
  const auto scenario = ChooseScenario(query.scenario);
  if (!scenario.ok()) return scenario.status();
  auto prepared = Prepare(*scenario, query.initial_condition);
  if (!prepared.ok()) return InRequest(prepared.status());
  GainQueryAnswer answer{.scenario_digest = ScenarioDigest(*scenario), .prepared = *std::move(prepared)};
  QueryOptions options;
  if (query.max_candidates > 0) options.max_candidates = query.max_candidates;
  if (query.max_answers > 0) options.max_answers = query.max_answers;
  const auto library = library_.Find(answer.scenario_digest);
  const Fly fly = [&cancelled](const EpisodeProblem& problem, std::span<const Gains> gains,
                               std::span<EpisodeResult> results) { FlyBatch(problem, gains, results, cancelled); };
  answer.result = QueryLibrary(library.get(), answer.prepared, scenario->search.initial_gains, options, fly);
  if (query.refine_budget_ms) {
    const int budget_ms = *query.refine_budget_ms > 0 ? *query.refine_budget_ms : kDefaultRefineMs;
    RefineAnswers(answer.prepared,
                  {.budget = std::chrono::milliseconds(budget_ms),
                   .cancelled = cancelled,
                   .gain_floor = scenario->search.gain_floor},
                  fly, static_cast<std::size_t>(options.max_answers), answer.result);
  }
  if (cancelled && cancelled()) return absl::CancelledError("nobody waits for the answer any more");
  answer.message = Advice(*scenario, answer);
  return answer;
}

// Empty where the answer is good.
std::string GainUseCases::Advice(const Scenario& scenario, const GainQueryAnswer& answer) const {
  const QueryResult& result = answer.result;
  const LibraryPosition& position = result.position;
  const std::string tune = " To tune for this start now: TuningService.CreateJob, or `orbitune submit`.";
  std::string advice;
  if (position.library_size == 0) {
    advice = absl::StrCat("No gains are stored for ", NamedScenario(scenario),
                          "; the answer is its initial gains, flown from this start.",
                          SimilarScenarios(scenario, answer.scenario_digest));
  } else if (position.extrapolated && position.located > 0) {
    advice = absl::StrFormat("This start is outside of the library: %.3g of its spreads from the nearest start stored",
                             position.nearest_distance);
    absl::StrAppend(&advice, std::isnan(position.typical_distance)
                                 ? ", and no other is stored."
                                 : absl::StrFormat(", where %.3g is usual between two.", position.typical_distance));
  }
  if (!result.settled()) {
    absl::StrAppend(&advice, advice.empty() ? "" : " ", "None of the ", result.candidates,
                    " candidates settles from here. The first: ", result.answers.front().flight.outcome_message, ".");
  }
  return advice.empty() ? advice : advice + tune;
}

// What is stored for scenarios that differ in their units alone: those gains are numbers for other units.
std::string GainUseCases::SimilarScenarios(const Scenario& scenario, const std::string& digest) const {
  std::string similar;
  for (const Scenario& other : library_.Definitions()) {
    const std::vector<std::string> differences = DigestDifferences(other, scenario);
    const bool units_alone =
        std::ranges::all_of(differences, [](const std::string& d) { return d.find("_unit_m_s") != std::string::npos; });
    if (!units_alone || ScenarioDigest(other) == digest) continue;
    absl::StrAppend(&similar, " Gains are stored for ", NamedScenario(other), " in other units (",
                    absl::StrJoin(differences, "; "), "): as numbers they are other gains here, and were not used.");
  }
  return similar;
}

// ---- stored gain sets

absl::StatusOr<GainSet> GainUseCases::Get(const std::string& id) { return store_.gains().GetGainSet(id); }

absl::StatusOr<WarmStart> GainUseCases::WarmStartFrom(const std::string& id) {
  const auto set = Get(id);
  if (!set.ok()) return set.status();
  return WarmStart{set->gains, set->velocity_unit_m_s, set->acceleration_unit_m_s2};
}

absl::StatusOr<Page<GainSet>> GainUseCases::List(int page_size, const std::string& page_token,
                                                 const std::string& filter) {
  const auto size = PageSize(page_size, 50, 1000);
  if (!size.ok()) return size.status();
  GainSetQuery query{.limit = *size + 1};  // the one beyond tells whether there is a next page
  if (absl::Status status = ParseGainSetFilter(filter, query); !status.ok()) return status;
  const std::string list = absl::StrCat("gainSets\n", filter);
  if (!page_token.empty()) {
    const auto parts = ReadPageToken(page_token, list, 2);
    if (!parts.ok()) return parts.status();
    query.after.emplace().id = parts->at(1);
    (void)absl::SimpleAtoi(parts->at(0), &query.after->create_time_us);
  }
  auto sets = store_.gains().ListGainSets(query);
  if (!sets.ok()) return sets.status();
  Page<GainSet> page{.items = *std::move(sets)};
  if (page.items.size() == static_cast<std::size_t>(query.limit)) {
    page.items.pop_back();
    page.next_page_token = MakePageToken(list, {absl::StrCat(page.items.back().create_time_us), page.items.back().id});
  }
  return page;
}

absl::Status GainUseCases::Delete(const std::string& id) {
  const auto set = store_.gains().GetGainSet(id);
  if (!set.ok()) return set.status();
  if (absl::Status status = store_.ok_for_now(); !status.ok()) return status;
  std::promise<absl::Status> deleted;
  store_.gains().DeleteGainSet(id, [&deleted](absl::Status status) { deleted.set_value(std::move(status)); });
  absl::Status status = deleted.get_future().get();
  if (status.ok()) library_.Remove(set->scenario_digest, id);
  return status;
}

// ---- import

namespace {

void CheckText(FieldErrors& errors, std::string_view field, const std::string& text) {
  if (text.size() > kLongestName) {
    errors.Add(field, absl::StrCat("at most ", kLongestName, " bytes"), FormatReceived(text));
  }
}

void CheckUnit(FieldErrors& errors, std::string_view field, std::optional<double> given, double scenarios) {
  // A file may have it with fewer digits.
  if (given && !(std::abs(*given - scenarios) <= 1e-9 * scenarios)) {
    errors.AddNumber(field, absl::StrCat(FormatNumber(scenarios), ", the scenario's"), *given);
  }
}

// What the set was flown in: a definition, a preset, or what the library knows by the digest.
absl::StatusOr<Scenario> ScenarioOf(const ImportedGainSet& given, const GainLibrary& library) {
  ScenarioChoice choice = given.scenario;
  if (choice.definition) {
    // Exports leave the chaser out; it is in no cost.
    if (std::holds_alternative<std::monostate>(choice.definition->chaser)) {
      choice.definition->chaser = given.initial_condition;
    }
    choice.preset_id.clear();
  } else if (FindPreset(choice.preset_id) == nullptr) {
    if (auto known = library.FindDefinition(given.scenario_digest)) {
      known->id = choice.preset_id;
      known->chaser = given.initial_condition;
      return *known;
    }
  }
  auto scenario = ChooseScenario(choice);
  if (!scenario.ok() || !choice.definition) return scenario;
  // A definition under a preset's name is that preset where no cost can tell them apart.
  const Scenario* preset = FindPreset(choice.definition->id);
  if (preset != nullptr && ScenarioDigest(*preset) == ScenarioDigest(*scenario)) scenario->id = preset->id;
  return scenario;
}

absl::Status CheckForm(const ImportedGainSet& given) {
  FieldErrors errors;
  CheckText(errors, "display_name", given.display_name);
  CheckText(errors, "algorithm", given.algorithm);
  CheckText(errors, "engine_version", given.engine_version);
  CheckText(errors, "history_digest", given.history_digest);
  CheckText(errors, "name", given.origin);
  if (given.iteration < 0) errors.AddNumber("iteration", ">= 0", given.iteration);
  for (std::size_t i = 0; i < kGainCount; ++i) {
    if (given.gains[i] > 0 && given.gains[i] <= SearchOptions::kMaxGain) continue;
    errors.AddNumber(absl::StrCat("gains.k", i + 1), absl::StrCat("in (0, ", SearchOptions::kMaxGain, "]"),
                     given.gains[i]);
  }
  if (std::holds_alternative<std::monostate>(given.initial_condition)) {
    errors.Add("initial_condition", "where the gains were flown from", "none");
  }
  return errors.ToStatus();
}

absl::Status CheckBelongs(const ImportedGainSet& given, const GainSet& set) {
  FieldErrors errors;
  if (!given.scenario_digest.empty() && given.scenario_digest != set.scenario_digest) {
    errors.Add("scenario_digest", absl::StrCat(set.scenario_digest, ", that of ", NamedScenario(set.scenario), " here"),
               FormatReceived(given.scenario_digest));
  }
  CheckUnit(errors, "velocity_unit_m_s", given.velocity_unit_m_s, set.velocity_unit_m_s);
  CheckUnit(errors, "acceleration_unit_m_s2", given.acceleration_unit_m_s2, set.acceleration_unit_m_s2);
  return errors.ToStatus();
}

// Flies the gains from their start, as the search would. An error for what has no cost.
absl::Status FlyImported(const PreparedScenario& prepared, const std::function<bool()>& cancelled, GainSet& set) {
  EpisodeResult result;
  FlyBatch(prepared.problem, {&set.gains, 1}, {&result, 1}, cancelled);
  set.flight = Measure(prepared, {.gains = set.gains}, result).flight;
  if (HasCost(result.outcome)) return absl::OkStatus();
  FieldErrors errors;
  errors.Add("gains", "such that they can be flown from initial_condition", set.flight.outcome_message);
  return errors.ToStatus();
}

absl::StatusOr<GainSet> MakeImported(const ImportedGainSet& given, const GainLibrary& library,
                                     const std::function<bool()>& cancelled) {
  if (absl::Status status = CheckForm(given); !status.ok()) return status;
  const auto scenario = ScenarioOf(given, library);
  if (!scenario.ok()) return scenario.status();
  const auto prepared = Prepare(*scenario, given.initial_condition);
  if (!prepared.ok()) return InRequest(prepared.status());
  GainSet set;
  set.kind = GainSetKind::kImported;
  set.display_name = given.display_name;
  set.gains = given.gains;
  set.velocity_unit_m_s = prepared->velocity_unit_m_s;
  set.acceleration_unit_m_s2 = prepared->acceleration_unit_m_s2;
  set.scenario = LibraryDefinition(*scenario);
  set.scenario_digest = ScenarioDigest(*scenario);
  set.initial_condition = given.initial_condition;
  set.initial_error = prepared->problem.initial_error;
  set.iteration = given.iteration;
  set.algorithm = given.algorithm;
  set.seed = given.seed;
  set.engine_version = given.engine_version;
  set.history_digest = given.history_digest;
  set.origin = given.origin;
  absl::Status status = CheckBelongs(given, set);
  if (status.ok()) status = FlyImported(*prepared, cancelled, set);
  if (!status.ok()) return status;
  return set;
}

absl::StatusOr<std::vector<GainSet>> MakeAll(const std::vector<ImportedGainSet>& given, const GainLibrary& library,
                                             const std::function<bool()>& cancelled) {
  FieldErrors errors;
  if (given.empty() || given.size() > GainUseCases::kMostImported) {
    errors.AddNumber("gain_sets", absl::StrCat("1 to ", GainUseCases::kMostImported, " gain sets"),
                     static_cast<double>(given.size()));
    return errors.ToStatus();
  }
  std::vector<GainSet> sets;
  std::size_t faults = 0;
  for (std::size_t i = 0; i < given.size() && faults < kMostFaults; ++i) {
    auto set = MakeImported(given[i], library, cancelled);
    if (cancelled && cancelled()) return absl::CancelledError("nobody waits for the import any more");
    if (set.ok()) {
      sets.push_back(*std::move(set));
    } else {
      errors.Merge(absl::StrCat("gain_sets[", i, "]"), set.status());
      ++faults;
    }
  }
  if (!errors.empty()) return errors.ToStatus();
  return sets;
}

// The same gains from the same start in the same scenario are the same gain set.
using Identity = std::tuple<std::string, Gains, std::array<double, 6>>;
Identity IdentityOf(const GainSet& set) {
  const ErrorState& x = *set.initial_error;
  return {set.scenario_digest, set.gains, {x.x1, x.x2, x.x3, x.x4, x.x5, x.x6}};
}

}  // namespace

absl::StatusOr<std::optional<GainSet>> GainUseCases::FindSame(const GainSet& set) const {
  const auto library = library_.Find(set.scenario_digest);
  if (library == nullptr) return std::nullopt;
  constexpr std::size_t kAtOneStart = 64;
  for (const auto& [entry, distance] : library->Around(*set.initial_error, kAtOneStart, 0).nearest) {
    if (distance > 0 || entry.gains != set.gains) continue;
    auto same = store_.gains().GetGainSet(entry.id);
    if (same.ok()) return std::optional(*std::move(same));
    if (!absl::IsNotFound(same.status())) return same.status();
  }
  return std::nullopt;
}

absl::Status GainUseCases::Store(const std::vector<GainSet>& sets) {
  if (sets.empty()) return absl::OkStatus();
  if (absl::Status status = store_.ok_for_now(); !status.ok()) return status;
  std::promise<absl::Status> stored;
  store_.gains().AddGainSets(sets, [&stored](absl::Status status) { stored.set_value(std::move(status)); });
  absl::Status status = stored.get_future().get();
  if (status.ok()) AddToLibrary(sets, library_);
  return status;
}

absl::StatusOr<GainSetImport> GainUseCases::Import(const std::vector<ImportedGainSet>& given, bool validate_only,
                                                   const std::function<bool()>& cancelled) {
  auto sets = MakeAll(given, library_, cancelled);
  if (!sets.ok()) return sets.status();
  std::vector<GainSet> added;
  std::map<Identity, std::size_t> twins;  // in `added`
  const TimeUs now = NowUs();
  for (GainSet& set : *sets) {
    auto same = FindSame(set);
    if (!same.ok()) return same.status();
    if (*same) {
      set = **std::move(same);
      continue;
    }
    const auto [twin, is_new] = twins.emplace(IdentityOf(set), added.size());
    if (is_new) {
      set.id = validate_only ? "" : NewId();
      set.create_time_us = now;
      added.push_back(set);
    } else {
      set = added[twin->second];
    }
  }
  if (!validate_only) {
    if (absl::Status status = Store(added); !status.ok()) return status;
  }
  return GainSetImport{.sets = *std::move(sets), .imported = static_cast<int>(added.size())};
}

}  // namespace orbitune
