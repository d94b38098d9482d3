// The list requests' texts: filters, orders, page tokens.
#include "server/service/list_filter.h"
#include "server/service/page_token.h"
#include "tests/fuzz/fuzz.h"

namespace orbitune::fuzz {
namespace {

void Filter(std::string_view input) {
  JobQuery jobs;
  GainSetQuery gain_sets;
  switch (TakeChoice(input, 3)) {
    case 0:
      (void)ParseFilter(input);
      break;
    case 1:
      (void)ParseOrder(input, jobs);
      break;
    default:
      (void)ParseGainSetFilter(input, gain_sets);
  }
}

// The first line is the list, the rest the token; or the parts that one is made of.
void PageToken(std::string_view input) {
  const std::string_view list = TakeLine(input);
  if (auto parts = ReadPageToken(input, list, 2); parts.ok()) {
    const auto again = ReadPageToken(MakePageToken(list, *parts), list, 2);
    Expect(again.ok() && *again == *parts, "a token that is read is a token that is made");
  }
  const std::vector<std::string> parts = {std::string(TakeLine(input)), std::string(TakeLine(input))};
  const auto read = ReadPageToken(MakePageToken(list, parts), list, 2);
  Expect(read.ok() && *read == parts, "a page token gives back its parts");
  Expect(!ReadPageToken(MakePageToken(list, parts), std::string(list) + "x", 2).ok(), "it is of its list alone");
}

const Registration kFilter("filter", Filter);
const Registration kPageToken("page_token", PageToken);

}  // namespace
}  // namespace orbitune::fuzz
