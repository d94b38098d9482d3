#include "server/service/list_filter.h"

#include <array>
#include <cctype>
#include <functional>

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

// The fields of one list.
struct Fields {
  std::string_view names;  // for an error
  std::function<bool(std::string_view field)> known;
  // Takes over a comparison with a known field; returns what was expected in place of the value, or "".
  std::function<std::string(const std::string& field, bool negated, const std::string& value)> apply;
};

class Parser {
 public:
  Parser(std::string_view text, const Fields& fields) : text_(text), fields_(fields) {}

  absl::Status Parse() {
    Next();
    if (token_.kind == Token::Kind::kEnd && error_.empty()) return absl::OkStatus();
    while (error_.empty()) {
      Comparison();
      if (!error_.empty() || token_.kind == Token::Kind::kEnd) break;
      if (token_.kind != Token::Kind::kWord || token_.value != "AND") Fail("AND");
      Next();
    }
    if (error_.empty()) return absl::OkStatus();
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
    if (field.kind != Token::Kind::kWord || !fields_.known(field.value)) return Fail(fields_.names);
    Next();
    if (token_.kind != Token::Kind::kOperator) return Fail("= or !=");
    const bool negated = token_.value == "!=";
    Next();
    if (token_.kind != Token::Kind::kWord && token_.kind != Token::Kind::kText) return Fail("a value");
    if (const std::string expected = fields_.apply(field.value, negated, token_.value); !expected.empty()) {
      return Fail(expected);
    }
    Next();
  }

  const std::string_view text_;
  const Fields& fields_;
  std::size_t at_ = 0;
  Token token_;
  std::string error_;  // what was expected, once something was not
};

// "jobs/x" and "x" are both x in the collection "jobs/".
std::string IdIn(std::string_view collection, const std::string& value) {
  return value.starts_with(collection) ? value.substr(collection.size()) : value;
}

std::string ApplyToJobs(JobFilter& filter, const std::string& field, bool negated, const std::string& value) {
  if (field == "state") {
    const auto state = JobStateOf(value);
    if (!state.ok()) return "a state: QUEUED, RUNNING, PAUSED, SUCCEEDED, FAILED or CANCELLED";
    (negated ? filter.not_states : filter.states).push_back(*state);
  } else if (field == "scenario") {
    (negated ? filter.not_scenario_ids : filter.scenario_ids).push_back(IdIn("scenarios/", value));
  } else if (field == "campaign") {
    if (negated || !filter.campaign_id.empty()) return "one comparison campaign = ID at most";
    if (value.empty()) return "the id of a campaign";
    filter.campaign_id = IdIn("campaigns/", value);
  } else if (field == "text") {
    if (negated) return "text = alone, not !=";
    filter.texts.push_back(value);
  } else {
    filter.labels.push_back({field.substr(kLabelPrefix.size()), value, negated});
  }
  return "";
}

std::string ApplyToGainSets(GainSetQuery& query, const std::string& field, bool negated, const std::string& value) {
  if (negated) return "=";
  if (field == "scenario") {
    query.scenario_ids.push_back(IdIn("scenarios/", value));
  } else if (field == "job") {
    query.job_ids.push_back(IdIn("jobs/", value));
  } else if (field == "campaign") {
    query.campaign_ids.push_back(IdIn("campaigns/", value));
  } else {
    const auto kind = GainSetKindOf(value);
    if (!kind.ok()) return "a kind: TUNED, ROBUST, MEAN or IMPORTED";
    query.kinds.push_back(*kind);
  }
  return "";
}

// Two different values asked of one field: AND leaves nothing, where the store's lists mean "any of".
absl::Status TwiceAsked(std::string_view fields, std::string_view text) {
  FieldErrors errors;
  errors.Add("filter", absl::StrCat("one = comparison at most for each of ", ToAbsl(fields)), FormatReceived(text));
  return errors.ToStatus();
}

}  // namespace

absl::StatusOr<JobFilter> ParseFilter(std::string_view text) {
  JobFilter filter;
  const Fields fields{.names = "state, scenario, campaign, text or labels.KEY",
                      .known =
                          [](std::string_view field) {
                            return field == "state" || field == "scenario" || field == "campaign" || field == "text" ||
                                   (field.starts_with(kLabelPrefix) && field.size() > kLabelPrefix.size());
                          },
                      .apply = std::bind_front(ApplyToJobs, std::ref(filter))};
  if (absl::Status status = Parser(text, fields).Parse(); !status.ok()) return status;
  if (filter.states.size() > 1 || filter.scenario_ids.size() > 1) return TwiceAsked("state and scenario", text);
  return filter;
}

absl::Status ParseGainSetFilter(std::string_view text, GainSetQuery& query) {
  const Fields fields{.names = "kind, scenario, job or campaign",
                      .known =
                          [](std::string_view field) {
                            return field == "kind" || field == "scenario" || field == "job" || field == "campaign";
                          },
                      .apply = std::bind_front(ApplyToGainSets, std::ref(query))};
  if (absl::Status status = Parser(text, fields).Parse(); !status.ok()) return status;
  const bool once = query.kinds.size() <= 1 && query.scenario_ids.size() <= 1 && query.job_ids.size() <= 1 &&
                    query.campaign_ids.size() <= 1;
  return once ? absl::OkStatus() : TwiceAsked("kind, scenario, job and campaign", text);
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
