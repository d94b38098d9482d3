#include "storage/sqlite_list_query.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <span>

#include "absl/strings/str_cat.h"
#include "storage/serialise.h"

namespace orbitune {
namespace {

// Grows one WHERE clause, every condition with its values.
class Conditions {
 public:
  void Add(std::string_view condition) { absl::StrAppend(&text_, text_.empty() ? "" : " AND ", ToAbsl(condition)); }

  void Add(std::string_view condition, std::initializer_list<Statement::Value> values) {
    Add(condition);
    values_.insert(values_.end(), values);
  }

  // column IN (...), or NOT IN; nothing where `texts` is empty.
  void AddSet(std::string_view column, std::string_view in, std::span<const std::string> texts) {
    if (texts.empty()) return;
    std::string places;
    for (const std::string& text : texts) {
      absl::StrAppend(&places, places.empty() ? "?" : ", ?");
      values_.emplace_back(text);
    }
    Add(absl::StrCat(ToAbsl(column), " ", ToAbsl(in), " (", places, ")"));
  }

  ListQuery Finish(std::string_view order_by, std::int64_t limit) && {
    values_.emplace_back(limit);
    return {absl::StrCat(text_.empty() ? "" : " WHERE ", text_, " ORDER BY ", ToAbsl(order_by), " LIMIT ?"),
            std::move(values_)};
  }

 private:
  std::string text_;
  std::vector<Statement::Value> values_;
};

std::vector<std::string> NamesOf(const std::vector<JobState>& states) {
  std::vector<std::string> names;
  for (const JobState state : states) names.emplace_back(NameOf(state));
  return names;
}

Conditions FilterConditions(const JobFilter& filter) {
  Conditions where;
  if (filter.campaign_id.empty()) {
    where.Add("campaign IS NULL");
  } else {
    where.Add("campaign = ?", {filter.campaign_id});
  }
  where.AddSet("state", "IN", NamesOf(filter.states));
  where.AddSet("state", "NOT IN", NamesOf(filter.not_states));
  where.AddSet("scenario_id", "IN", filter.scenario_ids);
  where.AddSet("scenario_id", "NOT IN", filter.not_scenario_ids);
  for (const JobFilter::Label& label : filter.labels) {
    where.Add(absl::StrCat("jobs.key ", label.negated ? "NOT " : "",
                           "IN (SELECT job FROM job_labels WHERE label_key = ? AND value = ?)"),
              {label.key, label.value});
  }
  for (const std::string& text : filter.texts) {
    where.Add(
        "(instr(lower(id || ' ' || scenario_id || ' ' || json_extract(spec, '$.display_name')), lower(?)) > 0 OR "
        "jobs.key IN (SELECT job FROM job_labels WHERE instr(lower(label_key || '=' || value), lower(?)) > 0))",
        {text, text});
  }
  return where;
}

// A cursor's key is as a client's page token says it: any double.
std::int64_t TimeOf(double key) {
  constexpr double kFarthest = 9e18;
  return std::isnan(key) ? 0 : static_cast<std::int64_t>(std::clamp(key, -kFarthest, kFarthest));
}

std::vector<ListQuery> ByCreateTime(const JobQuery& query) {
  Conditions where = FilterConditions(query.filter);
  if (query.after) {
    where.Add(query.descending ? "(create_time_us, id) < (?, ?)" : "(create_time_us, id) > (?, ?)",
              {TimeOf(query.after->key), query.after->id});
  }
  return {
      std::move(where).Finish(query.descending ? "create_time_us DESC, id DESC" : "create_time_us, id", query.limit)};
}

std::vector<ListQuery> ByBestCost(const JobQuery& query) {
  std::vector<ListQuery> stretches;
  const bool within_rest = query.after && std::isnan(query.after->key);
  if (!within_rest) {
    Conditions where = FilterConditions(query.filter);
    where.Add("best_cost IS NOT NULL");
    if (query.after) {
      where.Add(query.descending ? "(best_cost, id) < (?, ?)" : "(best_cost, id) > (?, ?)",
                {query.after->key, query.after->id});
    }
    stretches.push_back(
        std::move(where).Finish(query.descending ? "best_cost DESC, id DESC" : "best_cost, id", query.limit));
  }
  Conditions where = FilterConditions(query.filter);
  where.Add("best_cost IS NULL");
  if (within_rest) where.Add(query.descending ? "id < ?" : "id > ?", {query.after->id});
  stretches.push_back(std::move(where).Finish(query.descending ? "id DESC" : "id", query.limit));
  return stretches;
}

}  // namespace

std::vector<ListQuery> MakeListQueries(const JobQuery& query) {
  return query.order == JobQuery::Order::kCreateTime ? ByCreateTime(query) : ByBestCost(query);
}

ListQuery MakeUnfinishedQuery() {
  constexpr std::int64_t kAll = -1;
  Conditions where;
  where.AddSet("state", "IN", NamesOf({JobState::kQueued, JobState::kRunning, JobState::kPaused}));
  return std::move(where).Finish("create_time_us, id", kAll);
}

}  // namespace orbitune
