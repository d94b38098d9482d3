// What the store reads back from its documents: whatever is accepted is written, and read again, as it was.
#include "storage/serialise.h"
#include "tests/fuzz/fuzz.h"

namespace orbitune::fuzz {
namespace {

std::string Text(std::string text) { return text; }
std::string Text(absl::StatusOr<std::string> text) {
  Expect(text.ok(), "what was read can be written");
  return *std::move(text);
}

template <typename Read>
void RoundTrip(std::string_view input, Read read) {
  const auto value = read(input);
  if (!value.ok()) return;
  const std::string text = Text(ToJson(*value));
  const auto again = read(text);
  Expect(again.ok(), "what was written can be read");
  Expect(Text(ToJson(*again)) == text, "and is the same");
}

void GainSetRoundTrip(std::string_view input) {
  GainSet set;
  if (!ReadGainSetDocument(input, set).ok()) return;
  const std::string text = GainSetDocument(set);
  GainSet again;
  Expect(ReadGainSetDocument(text, again).ok() && GainSetDocument(again) == text, "a gain set's document is the same");
}

void Document(std::string_view input) {
  switch (TakeChoice(input, 8)) {
    case 0:
      return RoundTrip(input, JobSpecFromJson);
    case 1:
      return RoundTrip(input, JobReportFromJson);
    case 2:
      return RoundTrip(input, ScenarioFromJson);
    case 3:
      return RoundTrip(input, CampaignSpecFromJson);
    case 4:
      return RoundTrip(input, CampaignResultsFromJson);
    case 5:
      return RoundTrip(input, MemberEpisodesFromJson);
    case 6:
      return RoundTrip(input, OrbitStateFromJson);
    default:
      GainSetRoundTrip(input);
  }
}

const Registration kDocument("document", Document);

}  // namespace
}  // namespace orbitune::fuzz
