#include "server/commands/audit.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "server/commands/support.h"
#include "server/config/config.h"

namespace orbitune {
namespace {

constexpr int kPage = 1000;
constexpr const char* kColumns[] = {"number", "time",     "caller",  "role",       "token_id", "peer",
                                    "method", "resource", "outcome", "request_id", "count"};

enum class Form { kTable, kJson, kCsv };

std::vector<std::string> Values(const AuditEntry& e) {
  return {absl::StrCat(e.number),
          FormatTime(e.time_us),
          e.caller,
          e.role,
          e.token_id,
          e.peer,
          e.method,
          e.resource,
          e.outcome,
          e.request_id,
          absl::StrCat(e.count)};
}

// A line of JSON each, for there may be many.
std::string ToJsonLine(const AuditEntry& e) {
  nlohmann::ordered_json json;
  const auto values = Values(e);
  for (std::size_t i = 0; i < values.size(); ++i) json[kColumns[i]] = values[i];
  json["number"] = e.number;
  json["count"] = e.count;
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

std::string ToCsvLine(const std::vector<std::string>& values) {
  std::string line;
  for (const std::string& value : values) {
    const bool quoted = value.find_first_of(",\"\r\n") != std::string::npos;
    absl::StrAppend(&line, line.empty() ? "" : ",",
                    quoted ? absl::StrCat("\"", absl::StrReplaceAll(value, {{"\"", "\"\""}}), "\"") : value);
  }
  return line + "\n";
}

void Print(const std::vector<AuditEntry>& entries, Form form, bool first) {
  const std::vector<std::string> columns(std::begin(kColumns), std::end(kColumns));
  std::vector<std::vector<std::string>> rows = {columns};
  std::string text = form == Form::kCsv && first ? ToCsvLine(columns) : "";
  for (const AuditEntry& entry : entries) {
    if (form == Form::kTable) rows.push_back(Values(entry));
    if (form == Form::kJson) text += ToJsonLine(entry);
    if (form == Form::kCsv) text += ToCsvLine(Values(entry));
  }
  if (form == Form::kTable && (first || !entries.empty())) text = FormatTable(rows);
  std::fwrite(text.data(), 1, text.size(), stdout);
}

absl::Status Export(const std::string& data_dir, AuditQuery query, Form form) {
  const auto store = OpenAccessStore(data_dir);
  if (!store.ok()) return store.status();
  for (bool first = true;; first = false) {
    const auto entries = (*store)->ListAudit(query);
    if (!entries.ok()) return entries.status();
    Print(*entries, form, first);
    if (entries->size() < static_cast<std::size_t>(kPage)) return absl::OkStatus();
    query.after_number = entries->back().number;
  }
}

}  // namespace

int RunAudit(int argc, char** argv) {
  std::string data_dir = DefaultDataDir();
  std::string since;
  std::string until;
  bool json = false;
  bool csv = false;
  CLI::App app("Who did what: every change, and what was refused, the oldest first.", "orbituned audit");
  app.add_option("--data-dir", data_dir, "The server's")->envname("ORBITUNE_DATA_DIR")->capture_default_str();
  app.add_option("--since", since, "2026-11-22, 2026-11-22T10:00:00Z, or so long ago: 90m, 24h, 7d");
  app.add_option("--until", until, "Likewise; entries before it");
  CLI::Option* const as_json = app.add_flag("--json", json, "A JSON object a line");
  app.add_flag("--csv", csv, "As CSV")->excludes(as_json);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  AuditQuery query{.limit = kPage};
  for (const auto& [option, text, value] :
       {std::tuple("--since", &since, &query.since_us), std::tuple("--until", &until, &query.until_us)}) {
    if (text->empty()) continue;
    const auto time = ParseTime(option, *text, NowUs());
    if (!time.ok()) return FailCommand(time.status());
    *value = *time;
  }
  const absl::Status status = Export(data_dir, query, json ? Form::kJson : csv ? Form::kCsv : Form::kTable);
  return status.ok() ? 0 : FailCommand(status);
}

}  // namespace orbitune
