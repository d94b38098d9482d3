#include "server/service/list_filter.h"

#include <array>
#include <cctype>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "storage/serialise.h"

namespace orbitune {
namespace {

constexpr std::string_view kLabelPrefix = "labels.";

struct Token {
  enum class Kind { kWord, kText, kOperator, kEnd } kind = Kind::kEnd;
  std::string value;
  std::size_t at = 0;
};

class Parser {
 public:
  explicit Parser(std::string_view text) : text_(text) {}

  absl::StatusOr<JobFilter> Parse() {
    Next();
    if (token_.kind == Token::Kind::kEnd && error_.empty()) return filter_;
    while (error_.empty()) {
      Comparison();
      if (!error_.empty() || token_.kind == Token::Kind::kEnd) break;
      if (token_.kind != Token::Kind::kWord || token_.value != "AND") Fail("AND");
      Next();
    }
    if (error_.empty()) return filter_;
    FieldErrors errors;
    errors.Add("filter", absl::StrCat("comparisons joined by AND; at character ", token_.at + 1, ": ", error_),
               FormatReceived(text_));
    return errors.ToStatus();
  }

 private:
  static bool IsWordCharacter(char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '-' || c == '.' || c == '/';
  }

  void Fail(std::string_view expected) {
    if (error_.empty()) error_ = std::string(expected);
  }

  void Next() {
    if (!error_.empty()) return;
    while (at_ < text_.size() && text_[at_] == ' ') ++at_;
    token_ = {.kind = Token::Kind::kEnd, .value = "", .at = at_};
    if (at_ == text_.size()) return;
    if (text_[at_] == '"') return QuotedText();
    if (text_[at_] == '=') {
      token_ = {.kind = Token::Kind::kOperator, .value = "=", .at = at_++};
    } else if (text_.substr(at_, 2) == "!=") {
      token_ = {.kind = Token::Kind::kOperator, .value = "!=", .at = at_};
      at_ += 2;
    } else if (IsWordCharacter(text_[at_])) {
      token_.kind = Token::Kind::kWord;
      while (at_ < text_.size() && IsWordCharacter(text_[at_])) token_.value += text_[at_++];
    } else {
      Fail("a field, =, !=, AND, a word or a \"quoted\" text");
    }
  }

  void QuotedText() {
    token_.kind = Token::Kind::kText;
    for (++at_; at_ < text_.size() && text_[at_] != '"'; ++at_) {
      if (text_[at_] == '\\' && at_ + 1 < text_.size()) ++at_;
      token_.value += text_[at_];
    }
    if (at_ == text_.size()) return Fail("a closing quote");
    ++at_;
  }

  void Comparison() {
    const Token field = token_;
    const bool known = field.kind == Token::Kind::kWord &&
                       (field.value == "state" || field.value == "scenario" || field.value == "campaign" ||
                        (field.value.starts_with(kLabelPrefix) && field.value.size() > kLabelPrefix.size()));
    if (!known) return Fail("state, scenario, campaign or labels.KEY");
    Next();
    if (token_.kind != Token::Kind::kOperator) return Fail("= or !=");
    const bool negated = token_.value == "!=";
    Next();
    if (token_.kind != Token::Kind::kWord && token_.kind != Token::Kind::kText) return Fail("a value");
    Apply(field.value, negated, token_.value);
    Next();
  }

  void Apply(const std::string& field, bool negated, const std::string& value) {
    if (field == "state") {
      if (const auto state = JobStateOf(value); state.ok()) {
        return (negated ? filter_.not_states : filter_.states).push_back(*state);
      }
      return Fail("a state: QUEUED, RUNNING, PAUSED, SUCCEEDED, FAILED or CANCELLED");
    }
    if (field == "scenario") {
      constexpr std::string_view kPrefix = "scenarios/";
      const std::string id = value.starts_with(kPrefix) ? value.substr(kPrefix.size()) : value;
      return (negated ? filter_.not_scenario_ids : filter_.scenario_ids).push_back(id);
    }
    if (field == "campaign") {
      constexpr std::string_view kPrefix = "campaigns/";
      if (negated || !filter_.campaign_id.empty()) return Fail("one comparison campaign = ID at most");
      if (value.empty()) return Fail("the id of a campaign");
      filter_.campaign_id = value.starts_with(kPrefix) ? value.substr(kPrefix.size()) : value;
      return;
    }
    filter_.labels.push_back({field.substr(kLabelPrefix.size()), value, negated});
  }

  const std::string_view text_;
  std::size_t at_ = 0;
  Token token_;
  std::string error_;  // what was expected, once something was not
  JobFilter filter_;
};

}  // namespace

absl::StatusOr<JobFilter> ParseFilter(std::string_view text) {
  auto filter = Parser(text).Parse();
  // Two different values asked of one field: AND leaves nothing, where the store's lists mean "any of".
  if (filter.ok() && (filter->states.size() > 1 || filter->scenario_ids.size() > 1)) {
    FieldErrors errors;
    errors.Add("filter", "one = comparison at most for each of state and scenario", FormatReceived(text));
    return errors.ToStatus();
  }
  return filter;
}

absl::Status ParseOrder(std::string_view text, JobQuery& query) {
  struct Known {
    std::string_view text;
    JobQuery::Order order;
    bool descending;
  };
  constexpr std::array<Known, 5> kOrders = {{{"", JobQuery::Order::kCreateTime, true},
                                             {"create_time", JobQuery::Order::kCreateTime, false},
                                             {"create_time desc", JobQuery::Order::kCreateTime, true},
                                             {"best_cost", JobQuery::Order::kBestCost, false},
                                             {"best_cost desc", JobQuery::Order::kBestCost, true}}};
  for (const Known& known : kOrders) {
    if (text != known.text) continue;
    query.order = known.order;
    query.descending = known.descending;
    return absl::OkStatus();
  }
  FieldErrors errors;
  errors.Add("order_by", R"("create_time" or "best_cost", each with or without " desc")", FormatReceived(text));
  return errors.ToStatus();
}

}  // namespace orbitune
