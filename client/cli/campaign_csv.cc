#include "client/cli/campaign_csv.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"
#include "client/cli/campaign_text.h"
#include "client/cli/format.h"
#include "google/protobuf/descriptor.h"

namespace orbitune::cli {
namespace {

using google::protobuf::FieldDescriptor;

constexpr const char* kFixed[] = {"role", "number", "job", "job_state"};
constexpr const char* kOfEpisode[] = {"outcome",  "cost",        "settling_samples", "settling_time_s",
                                      "fuel_sum", "delta_v_m_s", "reduction_percent"};
constexpr const char* kGains[] = {"k1", "k2", "k3", "k4", "k5"};

// The forms that occur, by their field in OrbitState.
std::vector<const FieldDescriptor*> FormsOf(const std::vector<v1::CampaignMember>& members) {
  std::vector<const FieldDescriptor*> forms;
  const auto& state = *v1::OrbitState::descriptor();
  for (int i = 0; i < state.field_count(); ++i) {
    const auto has = [&](const v1::CampaignMember& m) {
      return m.initial_condition().GetReflection()->HasField(m.initial_condition(), state.field(i));
    };
    if (std::any_of(members.begin(), members.end(), has)) forms.push_back(state.field(i));
  }
  return forms;
}

void AddElements(const v1::CampaignMember& member, const FieldDescriptor* form, std::vector<std::string>* cells) {
  const v1::OrbitState& state = member.initial_condition();
  const auto& fields = *form->message_type();
  for (int i = 0; i < fields.field_count(); ++i) {
    if (!state.GetReflection()->HasField(state, form)) {
      cells->emplace_back();
      continue;
    }
    const google::protobuf::Message& elements = state.GetReflection()->GetMessage(state, form);
    const auto* const reflection = elements.GetReflection();
    const bool unset = fields.field(i)->has_presence() && !reflection->HasField(elements, fields.field(i));
    cells->push_back(unset ? "" : RoundTrip(reflection->GetDouble(elements, fields.field(i))));
  }
}

std::string OrEmpty(bool has, double value) { return has ? RoundTrip(value) : ""; }

void AddEpisode(const v1::MemberEpisode* episode, std::vector<std::string>* cells) {
  if (episode == nullptr) {
    cells->insert(cells->end(), std::size(kOfEpisode), "");
    return;
  }
  const std::string outcome = v1::Outcome_Name(episode->outcome());
  cells->emplace_back(absl::StripPrefix(outcome, "OUTCOME_"));
  cells->push_back(OrEmpty(episode->has_cost(), episode->cost()));
  cells->push_back(episode->has_settling_samples() ? absl::StrCat(episode->settling_samples()) : "");
  cells->push_back(OrEmpty(episode->has_settling_time_s(), episode->settling_time_s()));
  cells->push_back(OrEmpty(episode->has_fuel_sum(), episode->fuel_sum()));
  cells->push_back(OrEmpty(episode->has_delta_v_to_settling_m_s(), episode->delta_v_to_settling_m_s()));
  cells->push_back(OrEmpty(episode->has_cost_reduction_percent(), episode->cost_reduction_percent()));
}

void AddGains(const v1::MemberEpisode* episode, std::vector<std::string>* cells) {
  if (episode == nullptr) {
    cells->insert(cells->end(), std::size(kGains), "");
    return;
  }
  const v1::Gains& k = episode->gains();
  for (const double gain : {k.k1(), k.k2(), k.k3(), k.k4(), k.k5()}) cells->push_back(RoundTrip(gain));
}

template <typename Visit>
void ForEachChoice(const Visit& visit) {
  for (int i = v1::GainsChoice_MIN + 1; i <= v1::GainsChoice_MAX; ++i) visit(static_cast<v1::GainsChoice>(i));
}

// Beside the elements.
std::vector<std::string> EpisodeColumns() {
  std::vector<std::string> columns;
  ForEachChoice([&](v1::GainsChoice choice) {
    for (const char* const name : kOfEpisode) columns.push_back(absl::StrCat(ChoiceKey(choice), "_", name));
    for (const char* const name : kGains) columns.push_back(absl::StrCat(ChoiceKey(choice), "_", name));
  });
  return columns;
}

}  // namespace

bool IsCampaignCsvColumn(const std::string& name) {
  const auto columns = EpisodeColumns();
  return std::find(std::begin(kFixed), std::end(kFixed), name) != std::end(kFixed) ||
         std::find(columns.begin(), columns.end(), name) != columns.end();
}

std::string CampaignCsv(const std::vector<v1::CampaignMember>& members) {
  const auto forms = FormsOf(members);
  std::vector<std::string> header(std::begin(kFixed), std::end(kFixed));
  for (const FieldDescriptor* const form : forms) {
    for (int i = 0; i < form->message_type()->field_count(); ++i) {
      header.push_back(form->message_type()->field(i)->name());
    }
  }
  for (std::string& column : EpisodeColumns()) header.push_back(std::move(column));
  std::string text = absl::StrCat(absl::StrJoin(header, ","), "\n");
  for (const v1::CampaignMember& member : members) {
    std::vector<std::string> cells = {absl::StrReplaceAll(RoleText(member.role()), {{" ", "_"}}),
                                      absl::StrCat(member.number()), member.job(),
                                      member.job().empty() ? "" : StateText(member.job_state())};
    for (const FieldDescriptor* const form : forms) AddElements(member, form, &cells);
    ForEachChoice([&](v1::GainsChoice choice) {
      const v1::MemberEpisode* const episode = FindEpisode(member, choice);
      AddEpisode(episode, &cells);
      AddGains(episode, &cells);
    });
    absl::StrAppend(&text, absl::StrJoin(cells, ","), "\n");
  }
  return text;
}

}  // namespace orbitune::cli
