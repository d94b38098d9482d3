#include "client/cli/job_report.h"

#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/fields.h"
#include "client/cli/format.h"
#include "client/cli/table.h"

namespace orbitune::cli {
namespace {

using Result = v1::EpisodeResult;
using v1::Reduction;

// A row of numbers: the quantity of an episode and its reduction, for K(1), K(M) and the best K.
void AddRow(Table& table, const v1::JobReport& report, const std::string& title, double (*value)(const Result&),
            double (*reduction)(const Reduction&)) {
  // An episode that left the domain or failed has no cost, and nothing of it can be compared.
  const auto text = [&](const v1::GainsAssessment& of) {
    return of.result().has_cost() ? Human(value(of.result())) : "-";
  };
  const auto percent = [&](const v1::GainsAssessment& of, const Reduction& by) -> std::string {
    const bool comparable = report.initial().result().has_cost() && of.result().has_cost();
    return reduction == nullptr ? "" : comparable ? Percent(reduction(by)) : "-";
  };
  table.AddRow({title, text(report.initial()), text(report.final()), percent(report.final(), report.final_reduction()),
                text(report.best()), percent(report.best(), report.best_reduction())});
}

void PrintComparison(const v1::JobReport& report, std::ostream& out) {
  Table table({"", ">before, K(1)", absl::StrFormat(">after, K(%d)", report.final().iteration()), ">reduction",
               ">best K", ">reduction"});
  AddRow(
      table, report, "cost J", [](const Result& r) { return r.cost(); },
      [](const Reduction& r) { return r.cost_percent(); });
  AddRow(
      table, report, "settling time (samples)", [](const Result& r) { return 1.0 * r.settling_samples(); }, nullptr);
  AddRow(
      table, report, "settling time (h)", [](const Result& r) { return r.settling_time_s() / 3600; },
      [](const Reduction& r) { return r.settling_time_percent(); });
  AddRow(
      table, report, "fuel sum", [](const Result& r) { return r.fuel_sum(); },
      [](const Reduction& r) { return r.fuel_sum_percent(); });
  AddRow(
      table, report, "true delta-v to settling (m/s)", [](const Result& r) { return r.delta_v_to_settling_m_s(); },
      [](const Reduction& r) { return r.delta_v_percent(); });
  AddRow(
      table, report, "peak acceleration (m/s^2)", [](const Result& r) { return r.peak_acceleration_m_s2(); },
      [](const Reduction& r) { return r.peak_acceleration_percent(); });
  const Result& before = report.initial().result();
  const Result& after = report.final().result();
  const Result& best = report.best().result();
  table.AddRow(
      {"episode", OutcomeText(before.outcome()), OutcomeText(after.outcome()), "", OutcomeText(best.outcome()), ""});
  table.AddRow({"stays in the domain", GuaranteeText(before.domain_guarantee()),
                GuaranteeText(after.domain_guarantee()), "", GuaranteeText(best.domain_guarantee()), ""});
  table.Print(out);
}

void PrintGains(const v1::JobReport& report, std::ostream& out) {
  const std::string last = absl::StrCat("K(", report.final().iteration(), ")");
  out << absl::StrFormat("%-9s %s\n", "K(1)", GainsText(report.initial().gains(), 6))
      << absl::StrFormat("%-9s %s\n", last, GainsText(report.final().gains(), 6));
  if (!report.has_best()) {
    out << "best K    none: no episode settled\n";
    return;
  }
  out << absl::StrFormat("%-9s %s  (iteration %d)\n", "best K", GainsText(report.best().gains(), 6),
                         report.best().iteration());
}

std::string SpreadText(const v1::EnsembleResult::Spread& spread) {
  return absl::StrFormat("%.1f %% [%.1f %.1f]", spread.mean(), spread.min(), spread.max());
}

// The rows above are of the means over the initial conditions; these are the means of the reductions.
void PrintEnsembles(const v1::JobReport& report, std::ostream& out) {
  const v1::EnsembleResult& last = report.final().ensemble();
  const v1::EnsembleResult& best = report.best().ensemble();
  out << absl::StrFormat("\nover %d initial conditions: mean [min max] of the reductions of each\n",
                         best.initial_conditions());
  Table table({"", absl::StrFormat("K(%d)", report.final().iteration()), "best K"});
  table.AddRow({"settled", absl::StrCat(last.settled()), absl::StrCat(best.settled())});
  table.AddRow({"objective", Human(last.has_objective() ? std::optional(last.objective()) : std::nullopt),
                Human(best.has_objective() ? std::optional(best.objective()) : std::nullopt)});
  table.AddRow({"cost J", SpreadText(last.cost_reduction_percent()), SpreadText(best.cost_reduction_percent())});
  table.AddRow({"settling time", SpreadText(last.settling_time_reduction_percent()),
                SpreadText(best.settling_time_reduction_percent())});
  table.AddRow(
      {"fuel sum", SpreadText(last.fuel_sum_reduction_percent()), SpreadText(best.fuel_sum_reduction_percent())});
  table.Print(out);
}

std::string Elapsed(const v1::Job& job) {
  if (!job.has_start_time() || !job.has_end_time()) return "-";
  return HumanDuration(SecondsBetween(job.start_time(), job.end_time()));
}

void PrintTime(const char* title, bool set, const google::protobuf::Timestamp& time, std::ostream& out) {
  if (set) out << absl::StrFormat("%-32s %s\n", title, UtcTime(time));
}

void PrintIteration(const char* title, const v1::Iteration& iteration, std::ostream& out) {
  out << absl::StrFormat("%-32s %d  J %s  %s  K %s\n", title, iteration.iteration(), Human(CostOf(iteration)),
                         OutcomeText(iteration.outcome()), GainsText(iteration.gains(), 6));
}

void PrintProgress(const v1::Job& job, std::ostream& out) {
  out << absl::StrFormat("%-32s %d/%d\n", "iterations", job.completed_iterations(), ExpectedIterations(job));
  if (job.has_initial_iteration()) PrintIteration("first_iteration", job.initial_iteration(), out);
  if (job.has_latest_iteration()) PrintIteration("latest_iteration", job.latest_iteration(), out);
  if (job.has_best_iteration()) PrintIteration("best_iteration", job.best_iteration(), out);
}

void PrintProvenance(const v1::Provenance& provenance, std::ostream& out) {
  out << "provenance\n";
  const auto line = [&out](const std::string& title, const std::string& text) {
    out << absl::StrFormat("  %-30s %s\n", title, Printable(text));
  };
  line("scenario_digest", provenance.scenario_digest());
  line("inputs_digest", provenance.inputs_digest());
  line(absl::StrCat("digest (", provenance.iterations(), " iterations)"), provenance.digest());
  if (provenance.backfilled_iterations() > 0) {
    line("backfilled_iterations", absl::StrCat(provenance.backfilled_iterations()));
  }
  for (const v1::Engine& engine : provenance.engines()) {
    line(absl::StrCat("engine (from iteration ", engine.first_iteration(), ")"), EngineText(engine));
  }
}

}  // namespace

void PrintJobSummary(const v1::Job& job, std::ostream& out) {
  out << job.name() << "  " << StateText(job.state()) << '\n';
  if (!job.error_message().empty()) out << "error: " << Printable(job.error_message()) << '\n';
  out << absl::StrFormat("%d/%d iterations", job.completed_iterations(), ExpectedIterations(job));
  if (job.has_report()) out << absl::StrFormat(", %d episodes", job.report().episodes());
  out << ", elapsed " << Elapsed(job) << '\n';
  if (!job.has_report()) return;
  PrintGains(job.report(), out);
  out << '\n';
  PrintComparison(job.report(), out);
  if (job.report().best().has_ensemble()) PrintEnsembles(job.report(), out);
  if (!job.report().warnings().empty()) out << '\n';
  for (const v1::Warning& warning : job.report().warnings()) out << "warning: " << Printable(warning.message()) << '\n';
}

void PrintJob(const v1::Job& job, std::ostream& out) {
  out << absl::StrFormat("%-32s %s\n%-32s %s\n", "name", job.name(), "state", StateText(job.state()));
  if (!job.display_name().empty()) out << absl::StrFormat("%-32s %s\n", "display_name", Printable(job.display_name()));
  for (const auto& [key, value] : job.labels()) {
    out << absl::StrFormat("%-32s %s\n", absl::StrCat("labels.", Printable(key)), Printable(value));
  }
  if (job.priority() != 0) out << absl::StrFormat("%-32s %d\n", "priority", job.priority());
  out << absl::StrFormat("%-32s %s\n", "scenario", job.scenario().empty() ? "(its own definition)" : job.scenario());
  PrintTime("created", job.has_create_time(), job.create_time(), out);
  PrintTime("started", job.has_start_time(), job.start_time(), out);
  PrintTime("ended", job.has_end_time(), job.end_time(), out);
  if (job.has_initial_condition()) {
    out << "initial_condition\n";
    PrintFields(job.initial_condition(), 2, out);
  }
  if (job.initial_conditions_size() > 0) {
    out << absl::StrFormat("%-32s %d\n", "initial_conditions", job.initial_conditions_size()) << "objective\n";
    PrintFields(job.objective(), 2, out);
  }
  if (!job.warm_start().empty()) out << absl::StrFormat("%-32s %s\n", "warm_start", Printable(job.warm_start()));
  if (!job.campaign().empty()) out << absl::StrFormat("%-32s %s\n", "campaign", job.campaign());
  out << "hyperparameters\n";
  PrintFields(UsedHyperparameters(job), 2, out);
  PrintProgress(job, out);
  if (job.has_provenance()) PrintProvenance(job.provenance(), out);
  if (!Ended(job.state())) return;
  out << '\n';
  PrintJobSummary(job, out);
}

}  // namespace orbitune::cli
