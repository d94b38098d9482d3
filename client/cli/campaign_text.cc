#include "client/cli/campaign_text.h"

#include <cmath>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "client/cli/fields.h"
#include "client/cli/format.h"
#include "client/cli/table.h"

namespace orbitune::cli {
namespace {

std::string Tenths(double percent) { return std::isnan(percent) ? "-" : absl::StrFormat("%.1f", percent); }

void PrintLine(const char* title, const std::string& text, std::ostream& out) {
  out << absl::StrFormat("%-32s %s\n", title, text);
}

// The paper's: average, minimum and maximum of each reduction.
void PrintReductions(const v1::CampaignResults& results, v1::MemberRole over, std::ostream& out) {
  Table table({"", ">settled", ">cost: avg", ">min", ">max", ">settling: avg", ">min", ">max", ">fuel: avg", ">min",
               ">max", ">delta-v: avg"});
  for (const v1::GainsComparison& c : results.comparisons()) {
    if (c.over() != over || c.choice() == v1::GAINS_CHOICE_INITIAL) continue;
    table.AddRow({ChoiceText(c.choice()), absl::StrCat(c.settled(), "/", c.flown()), Tenths(c.cost().average()),
                  Tenths(c.cost().minimum()), Tenths(c.cost().maximum()), Tenths(c.settling_time().average()),
                  Tenths(c.settling_time().minimum()), Tenths(c.settling_time().maximum()),
                  Tenths(c.fuel_sum().average()), Tenths(c.fuel_sum().minimum()), Tenths(c.fuel_sum().maximum()),
                  Tenths(c.delta_v().average())});
  }
  table.Print(out);
}

void PrintPercentiles(const v1::CampaignResults& results, v1::MemberRole over, std::ostream& out) {
  Table table({"cost, percentiles", ">5", ">25", ">50", ">75", ">95"});
  for (const v1::GainsComparison& c : results.comparisons()) {
    if (c.over() != over || c.choice() == v1::GAINS_CHOICE_INITIAL) continue;
    const v1::ReductionStatistics& s = c.cost();
    table.AddRow({ChoiceText(c.choice()), Tenths(s.percentile_5()), Tenths(s.percentile_25()),
                  Tenths(s.percentile_50()), Tenths(s.percentile_75()), Tenths(s.percentile_95())});
  }
  table.Print(out);
}

const v1::GainsComparison* FindComparison(const v1::CampaignResults& results, v1::MemberRole over) {
  for (const v1::GainsComparison& c : results.comparisons()) {
    if (c.over() == over) return &c;
  }
  return nullptr;
}

std::string SourceText(const v1::InitialConditions& source, int members) {
  if (members == 0) return "none";
  if (!source.has_draw()) return absl::StrCat(members, ", listed");
  const char* const kind = source.draw().distribution().has_keplerian() ? "Keplerian" : "equinoctial";
  const int drawn = source.draw().count();
  return absl::StrCat(members, drawn == members ? ", drawn" : absl::StrCat(", ", drawn, " of them drawn"), " over ",
                      kind, " elements with seed ", source.draw().seed());
}

}  // namespace

std::string CampaignStateText(v1::CampaignState state) {
  const std::string name = v1::CampaignState_Name(state);
  return std::string(absl::StripPrefix(name, "CAMPAIGN_STATE_"));
}

std::string RoleText(v1::MemberRole role) {
  switch (role) {
    case v1::MEMBER_ROLE_TUNED:
      return "tuned";
    case v1::MEMBER_ROLE_HELD_OUT:
      return "held out";
    case v1::MEMBER_ROLE_ROBUST:
      return "robust";
    default:
      return "unknown";
  }
}

std::string ChoiceText(v1::GainsChoice choice) {
  switch (choice) {
    case v1::GAINS_CHOICE_INITIAL:
      return "K(1)";
    case v1::GAINS_CHOICE_TUNED:
      return "K*, each its own";
    case v1::GAINS_CHOICE_BEST:
      return "best K, each its own";
    case v1::GAINS_CHOICE_MEAN:
      return "K-hat, the mean of K*";
    case v1::GAINS_CHOICE_ROBUST:
      return "robust K";
    case v1::GAINS_CHOICE_NEAREST:
      return "K* of the nearest";
    default:
      return "unknown";
  }
}

std::string ChoiceKey(v1::GainsChoice choice) {
  const std::string name = v1::GainsChoice_Name(choice);
  return absl::AsciiStrToLower(absl::StripPrefix(name, "GAINS_CHOICE_"));
}

bool Ended(v1::CampaignState state) {
  return state == v1::CAMPAIGN_STATE_SUCCEEDED || state == v1::CAMPAIGN_STATE_FAILED ||
         state == v1::CAMPAIGN_STATE_CANCELLED;
}

const v1::MemberEpisode* FindEpisode(const v1::CampaignMember& member, v1::GainsChoice choice) {
  for (const v1::MemberEpisode& episode : member.episodes()) {
    if (episode.choice() == choice) return &episode;
  }
  return nullptr;
}

std::string MemberLine(const v1::CampaignMember& member, const v1::CampaignProgress& progress) {
  std::string line;
  if (member.role() == v1::MEMBER_ROLE_ROBUST) {
    line = "robust tuning";
  } else {
    const bool tuned = member.role() == v1::MEMBER_ROLE_TUNED;
    line = absl::StrCat(tuned ? "initial condition " : "held-out initial condition ", member.number(), "/",
                        tuned ? progress.tuned().members() : progress.held_out().members());
  }
  absl::StrAppend(&line, "  ", StateText(member.job_state()));
  const v1::MemberEpisode* const before = FindEpisode(member, v1::GAINS_CHOICE_INITIAL);
  const v1::MemberEpisode* const after = FindEpisode(member, v1::GAINS_CHOICE_TUNED);
  if (before != nullptr && after != nullptr) {
    const auto cost = [](const v1::MemberEpisode& e) { return e.has_cost() ? Human(e.cost()) : "-"; };
    absl::StrAppend(&line, "  J ", cost(*before), " -> ", cost(*after));
    if (after->has_cost_reduction_percent()) {
      absl::StrAppend(&line, "  reduction ", Percent(after->cost_reduction_percent()));
    }
    if (after->outcome() == v1::OUTCOME_SETTLED) {
      absl::StrAppend(&line, "  settles in ", Human(after->settling_time_s() / 3600), " h");
    } else {
      absl::StrAppend(&line, "  ", OutcomeText(after->outcome()));
    }
    absl::StrAppend(&line, "  K ", GainsText(after->gains()));
  }
  absl::StrAppend(&line, "  ", member.job());
  if (!member.error_message().empty()) absl::StrAppend(&line, "  ", Printable(member.error_message()));
  return line;
}

std::string ProgressText(const v1::CampaignProgress& progress) {
  std::string text =
      absl::StrCat(progress.tuned().ended(), " of ", progress.tuned().members(), " initial conditions tuned");
  const auto also = [&](const v1::CampaignProgress::Count& count, const char* what) {
    if (count.jobs() > 0) absl::StrAppend(&text, ", ", count.ended(), " of ", count.jobs(), " ", what);
  };
  also(progress.held_out(), "held-out ones");
  also(progress.robust(), "robust");
  const std::int64_t iterations = progress.tuned().completed_iterations() + progress.held_out().completed_iterations() +
                                  progress.robust().completed_iterations();
  return absl::StrCat(text, ", ", iterations, " iterations");
}

void PrintResults(const v1::CampaignResults& results, std::ostream& out) {
  out << absl::StrFormat("%-9s %s  (mean over %d)\n", "K-hat", GainsText(results.mean_gains(), 6), results.mean_of());
  if (results.has_robust_gains()) {
    out << absl::StrFormat("%-9s %s\n", "robust K", GainsText(results.robust_gains(), 6));
  }
  for (const v1::MemberRole over : {v1::MEMBER_ROLE_TUNED, v1::MEMBER_ROLE_HELD_OUT}) {
    const v1::GainsComparison* const comparison = FindComparison(results, over);
    if (comparison == nullptr) continue;
    out << absl::StrFormat("\nReductions in %% of the value under K(1), %d %s initial conditions:\n",
                           comparison->flown(), RoleText(over));
    PrintReductions(results, over, out);
    out << '\n';
    PrintPercentiles(results, over, out);
  }
  out << '\n' << Printable(results.conclusion()) << '\n';
}

void PrintCampaignSummary(const v1::Campaign& campaign, std::ostream& out) {
  out << campaign.name() << "  " << CampaignStateText(campaign.state()) << '\n';
  if (!campaign.error_message().empty()) out << "error: " << Printable(campaign.error_message()) << '\n';
  out << ProgressText(campaign.progress());
  if (campaign.has_results()) out << ", " << campaign.results().episodes() << " episodes";
  if (campaign.has_end_time()) {
    out << ", elapsed " << HumanDuration(SecondsBetween(campaign.create_time(), campaign.end_time()));
  }
  out << '\n';
  if (campaign.has_results()) PrintResults(campaign.results(), out);
}

void PrintCampaign(const v1::Campaign& campaign, std::ostream& out) {
  PrintLine("name", campaign.name(), out);
  PrintLine("state", CampaignStateText(campaign.state()), out);
  if (!campaign.display_name().empty()) PrintLine("display_name", Printable(campaign.display_name()), out);
  for (const auto& [key, value] : campaign.labels()) {
    PrintLine(absl::StrCat("labels.", Printable(key)).c_str(), Printable(value), out);
  }
  if (campaign.priority() != 0) PrintLine("priority", absl::StrCat(campaign.priority()), out);
  PrintLine("scenario", campaign.scenario().empty() ? "(its own definition)" : Printable(campaign.scenario()), out);
  PrintLine("created", UtcTime(campaign.create_time()), out);
  if (campaign.has_end_time()) PrintLine("ended", UtcTime(campaign.end_time()), out);
  const v1::CampaignProgress& progress = campaign.progress();
  PrintLine("initial_conditions", SourceText(campaign.initial_conditions(), progress.tuned().members()), out);
  PrintLine("held_out", SourceText(campaign.held_out(), progress.held_out().members()), out);
  out << "hyperparameters\n";
  PrintFields(campaign.hyperparameters(), 2, out);
  if (campaign.has_robust()) {
    out << "robust\n";
    PrintFields(campaign.robust(), 2, out);
  }
  if (!Ended(campaign.state())) {
    PrintLine("progress", ProgressText(progress), out);
    return;
  }
  out << '\n';
  PrintCampaignSummary(campaign, out);
}

}  // namespace orbitune::cli
