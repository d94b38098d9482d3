#include "client/cli/gains_file.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <functional>
#include <map>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "client/cli/files.h"
#include "client/cli/format.h"
#include "client/cli/initial_condition.h"
#include "client/cli/number.h"

namespace orbitune::cli {
namespace {

using google::protobuf::FieldDescriptor;

// What a column reads and writes. What the server finds out anew at an import is only written.
struct GainSetColumn {
  std::string name;
  std::function<std::string(const v1::GainSet&)> write;
  std::function<absl::Status(const std::string&, v1::GainSet*)> read;
};

absl::Status Ignore(const std::string&, v1::GainSet*) { return absl::OkStatus(); }

template <typename Get, typename Set>
GainSetColumn Text(const char* name, Get get, Set set) {
  return {name, [get](const v1::GainSet& s) { return Printable(get(s)); },
          [set](const std::string& text, v1::GainSet* s) {
            set(s, text);
            return absl::OkStatus();
          }};
}

template <typename T, typename Get, typename Set>
GainSetColumn Number(const char* name, Get get, Set set) {
  return {name,
          [get](const v1::GainSet& s) {
            if constexpr (std::is_floating_point_v<T>) {
              return RoundTrip(get(s));
            } else {
              return absl::StrCat(get(s));
            }
          },
          [set](const std::string& text, v1::GainSet* s) {
            if (text.empty()) return absl::OkStatus();
            const absl::StatusOr<T> value = ParseNumber<T>(text);
            if (value.ok()) set(s, *value);
            return value.status();
          }};
}

GainSetColumn Written(const char* name, std::function<std::string(const v1::GainSet&)> write) {
  return {name, std::move(write), Ignore};
}

// "key=value,..." of the form's own fields, as --ic takes it.
std::string StateText(const v1::OrbitState& state) {
  const FieldDescriptor* const form =
      state.GetReflection()->GetOneofFieldDescriptor(state, v1::OrbitState::descriptor()->oneof_decl(0));
  if (form == nullptr) return "";
  const google::protobuf::Message& message = state.GetReflection()->GetMessage(state, form);
  std::vector<std::string> pairs;
  for (int i = 0; i < message.GetDescriptor()->field_count(); ++i) {
    const FieldDescriptor* const field = message.GetDescriptor()->field(i);
    if (field->containing_oneof() != nullptr && !message.GetReflection()->HasField(message, field)) continue;
    pairs.push_back(absl::StrCat(field->name(), "=", RoundTrip(message.GetReflection()->GetDouble(message, field))));
  }
  return absl::StrJoin(pairs, ",");
}

GainSetColumn InitialConditionColumn() {
  return {"initial_condition", [](const v1::GainSet& s) { return StateText(s.initial_condition()); },
          [](const std::string& text, v1::GainSet* s) {
            if (text.empty()) return absl::OkStatus();
            const auto state = ParseInitialCondition(text);
            if (state.ok()) *s->mutable_initial_condition() = *state;
            return state.status();
          }};
}

#define ORBITUNE_DOUBLE(name, get, set) \
  Number<double>(                       \
      name, [](const v1::GainSet& s) { return s.get; }, [](v1::GainSet* s, double value) { s->set(value); })
#define ORBITUNE_TEXT(name, field)                           \
  Text(                                                      \
      #name, [](const v1::GainSet& s) { return s.field(); }, \
      [](v1::GainSet* s, const std::string& t) { s->set_##field(t); })

std::vector<GainSetColumn> MakeColumns() {
  std::vector<GainSetColumn> columns = {
      ORBITUNE_TEXT(name, name),
      Written("kind",
              [](const v1::GainSet& s) {
                return std::string(absl::StripPrefix(v1::GainSetKind_Name(s.kind()), "GAIN_SET_KIND_"));
              }),
      ORBITUNE_TEXT(display_name, display_name),
      ORBITUNE_TEXT(scenario, scenario),
      ORBITUNE_TEXT(scenario_digest, scenario_digest),
      ORBITUNE_DOUBLE("velocity_unit_m_s", velocity_unit_m_s(), set_velocity_unit_m_s),
      ORBITUNE_DOUBLE("acceleration_unit_m_s2", acceleration_unit_m_s2(), set_acceleration_unit_m_s2),
      ORBITUNE_DOUBLE("k1", gains().k1(), mutable_gains()->set_k1),
      ORBITUNE_DOUBLE("k2", gains().k2(), mutable_gains()->set_k2),
      ORBITUNE_DOUBLE("k3", gains().k3(), mutable_gains()->set_k3),
      ORBITUNE_DOUBLE("k4", gains().k4(), mutable_gains()->set_k4),
      ORBITUNE_DOUBLE("k5", gains().k5(), mutable_gains()->set_k5),
      InitialConditionColumn(),
      Written("x1", [](const v1::GainSet& s) { return RoundTrip(s.initial_error().x1()); }),
      Written("x2", [](const v1::GainSet& s) { return RoundTrip(s.initial_error().x2()); }),
      Written("x3", [](const v1::GainSet& s) { return RoundTrip(s.initial_error().x3()); }),
      Written("x4", [](const v1::GainSet& s) { return RoundTrip(s.initial_error().x4()); }),
      Written("x5", [](const v1::GainSet& s) { return RoundTrip(s.initial_error().x5()); }),
      Written("x6", [](const v1::GainSet& s) { return RoundTrip(s.initial_error().x6()); }),
      Written("job", [](const v1::GainSet& s) { return s.job(); }),
      Written("campaign", [](const v1::GainSet& s) { return s.campaign(); }),
      Number<std::int32_t>(
          "iteration", [](const v1::GainSet& s) { return s.iteration(); },
          [](v1::GainSet* s, std::int32_t value) { s->set_iteration(value); }),
      ORBITUNE_TEXT(algorithm, algorithm),
      Number<std::uint64_t>(
          "seed", [](const v1::GainSet& s) { return s.seed(); },
          [](v1::GainSet* s, std::uint64_t value) { s->set_seed(value); }),
      ORBITUNE_TEXT(engine_version, engine_version),
      Written("outcome", [](const v1::GainSet& s) { return OutcomeText(s.flight().outcome()); }),
      Written("cost", [](const v1::GainSet& s) { return s.flight().has_cost() ? RoundTrip(s.flight().cost()) : ""; }),
      Written("settling_samples", [](const v1::GainSet& s) { return absl::StrCat(s.flight().settling_samples()); }),
      Written("settling_time_s", [](const v1::GainSet& s) { return RoundTrip(s.flight().settling_time_s()); }),
      Written("fuel_sum", [](const v1::GainSet& s) { return RoundTrip(s.flight().fuel_sum()); }),
      Written("delta_v_m_s", [](const v1::GainSet& s) { return RoundTrip(s.flight().delta_v_m_s()); }),
      Written("peak_acceleration_m_s2",
              [](const v1::GainSet& s) { return RoundTrip(s.flight().peak_acceleration_m_s2()); }),
      Written("gains_positive",
              [](const v1::GainSet& s) { return absl::StrCat(s.flight().certificate().gains_positive()); }),
      Written("domain_guaranteed",
              [](const v1::GainSet& s) { return absl::StrCat(s.flight().certificate().domain_guaranteed()); }),
      Written("lyapunov_decreasing",
              [](const v1::GainSet& s) { return absl::StrCat(s.flight().certificate().lyapunov_decreasing()); }),
      Written("settled", [](const v1::GainSet& s) { return absl::StrCat(s.flight().certificate().settled()); }),
      Written("create_time", [](const v1::GainSet& s) { return UtcTime(s.create_time()); }),
  };
  return columns;
}
#undef ORBITUNE_DOUBLE
#undef ORBITUNE_TEXT

constexpr char kChecksum[] = "crc32";

const std::vector<GainSetColumn>& Columns() {
  static const auto* const columns = new std::vector<GainSetColumn>(MakeColumns());
  return *columns;
}

std::string Quoted(const std::string& cell) {
  if (cell.find_first_of(",\"") == std::string::npos) return cell;
  std::string quoted = "\"";
  for (const char c : cell) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + '"';
}

std::string Hex(std::uint32_t crc) { return absl::StrFormat("%08x", crc); }

std::string RowWithoutChecksum(const v1::GainSet& set) {
  std::vector<std::string> cells;
  for (const GainSetColumn& column : Columns()) cells.push_back(Quoted(column.write(set)));
  return absl::StrJoin(cells, ",");
}

// RFC 4180, within one line.
absl::StatusOr<std::vector<std::string>> SplitRow(const std::string& line) {
  std::vector<std::string> cells(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (quoted && line[i] == '"' && i + 1 < line.size() && line[i + 1] == '"') {
      cells.back() += line[i++];
    } else if (line[i] == '"') {
      quoted = !quoted;
    } else if (line[i] == ',' && !quoted) {
      cells.emplace_back();
    } else {
      cells.back() += line[i];
    }
  }
  if (quoted) return absl::InvalidArgumentError("a quote is not closed");
  return cells;
}

absl::Status At(const std::string& where, const std::string& what) {
  return absl::InvalidArgumentError(absl::StrCat(where, ": ", what));
}

absl::Status CheckChecksum(const std::string& where, const std::string& given, const std::string& content) {
  if (given.empty() || given == Hex(Crc32(content))) return absl::OkStatus();
  return At(where, absl::StrCat("crc32: the gain set was changed or damaged: its checksum is ", Hex(Crc32(content)),
                                ", the file says ", Printable(given), " (leave crc32 out of what is made by hand)"));
}

// The columns that the first line names; nullptr for the checksum.
absl::StatusOr<std::vector<const GainSetColumn*>> ReadHeader(const std::string& where, const std::string& line) {
  const auto names = SplitRow(line);
  if (!names.ok()) return At(where, std::string(names.status().message()));
  std::vector<const GainSetColumn*> columns;
  for (std::size_t i = 0; i < names->size(); ++i) {
    const std::string& name = (*names)[i];
    if (std::count(names->begin(), names->end(), name) > 1)
      return At(where, "column " + Printable(name) + " comes twice");
    const auto found =
        std::find_if(Columns().begin(), Columns().end(), [&](const GainSetColumn& c) { return c.name == name; });
    const bool checksum = name == kChecksum && i + 1 == names->size();
    if (found == Columns().end() && !checksum) {
      return At(where,
                absl::StrCat("'", Printable(name), "' is no column of gain sets (", kChecksum,
                             " is the last); the first line has to be their names, as of ", "`orbitune gains export`"));
    }
    columns.push_back(checksum ? nullptr : &*found);
  }
  for (const char* needed : {"scenario", "k1", "k2", "k3", "k4", "k5", "initial_condition"}) {
    if (std::count(names->begin(), names->end(), needed) == 0) {
      return At(where, absl::StrCat("the column ", needed, " is missing"));
    }
  }
  return columns;
}

absl::StatusOr<v1::GainSet> ReadRow(const std::string& where, const std::string& line,
                                    const std::vector<const GainSetColumn*>& columns) {
  const auto cells = SplitRow(line);
  if (!cells.ok()) return At(where, std::string(cells.status().message()));
  if (cells->size() != columns.size()) {
    return At(where, absl::StrCat(cells->size(), " cells where the first line names ", columns.size(), " columns"));
  }
  v1::GainSet set;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    if (columns[i] == nullptr) {
      const absl::Status status = CheckChecksum(where, cells->back(), line.substr(0, line.rfind(',')));
      if (!status.ok()) return status;
      continue;
    }
    const absl::Status status = columns[i]->read((*cells)[i], &set);
    if (!status.ok()) return At(where, absl::StrCat("column ", columns[i]->name, ": ", status.message()));
  }
  return set;
}

absl::StatusOr<std::vector<ReadGainSet>> ReadCsv(const std::string& path, const std::string& text) {
  std::vector<ReadGainSet> sets;
  std::vector<const GainSetColumn*> columns;
  int number = 0;
  for (absl::string_view view : absl::StrSplit(text, '\n')) {
    const std::string line(absl::StripSuffix(view, "\r"));
    const std::string where = absl::StrCat(path, ":", ++number);
    if (line.empty()) continue;
    if (columns.empty()) {
      auto header = ReadHeader(where, line);
      if (!header.ok()) return header.status();
      columns = *std::move(header);
      continue;
    }
    auto set = ReadRow(where, line, columns);
    if (!set.ok()) return set.status();
    sets.push_back({*std::move(set), where});
  }
  return sets;
}

absl::StatusOr<std::vector<ReadGainSet>> ReadJson(const std::string& path, const std::string& text) {
  v1::GainSetFile file;
  if (absl::Status status = ParseJson(text, path, &file); !status.ok()) return status;
  std::vector<ReadGainSet> sets;
  for (int i = 0; i < file.gain_sets_size(); ++i) {
    const v1::GainSetFile::Entry& entry = file.gain_sets(i);
    const std::string where = absl::StrCat(path, ": gain_sets[", i, "]");
    const absl::Status status = CheckChecksum(where, entry.crc32(), RowWithoutChecksum(entry.gain_set()));
    if (!status.ok()) return status;
    sets.push_back({entry.gain_set(), where});
  }
  return sets;
}

std::string LittleEndian(double value) {
  const auto bits = std::bit_cast<std::uint64_t>(value);
  std::string bytes;
  for (int i = 0; i < 8; ++i) bytes += static_cast<char>(bits >> (8 * i));
  return bytes;
}

// A name of the gain set's that C takes.
std::string Identifier(const std::string& name) {
  std::string identifier = "orbitune_gains_";
  for (const char c : absl::StripPrefix(name, "gainSets/")) {
    identifier += std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_';
  }
  return identifier;
}

// What must not end a comment early.
std::string InComment(const std::string& text) {
  std::string safe;
  for (const char c : Printable(text)) safe += (c == '*' || c == '\\') ? '.' : c;
  return safe;
}

}  // namespace

std::uint32_t Crc32(std::string_view bytes) {
  return static_cast<std::uint32_t>(
      crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size())));
}

std::string GainSetCsvHeader() {
  std::vector<std::string> names;
  for (const GainSetColumn& column : Columns()) names.push_back(column.name);
  names.emplace_back(kChecksum);
  return absl::StrJoin(names, ",");
}

std::string GainSetCsvRow(const v1::GainSet& set) {
  const std::string row = RowWithoutChecksum(set);
  return absl::StrCat(row, ",", Hex(Crc32(row)));
}

v1::GainSetFile ToGainSetFile(const std::vector<v1::GainSet>& sets) {
  v1::GainSetFile file;
  for (const v1::GainSet& set : sets) {
    v1::GainSetFile::Entry& entry = *file.add_gain_sets();
    *entry.mutable_gain_set() = set;
    entry.set_crc32(Hex(Crc32(RowWithoutChecksum(set))));
  }
  return file;
}

std::string GainSetCHeader(const v1::GainSet& set) {
  const v1::Gains& k = set.gains();
  const std::array<double, 7> values = {
      k.k1(), k.k2(), k.k3(), k.k4(), k.k5(), set.velocity_unit_m_s(), set.acceleration_unit_m_s2()};
  std::string bytes;
  for (const double value : values) bytes += LittleEndian(value);
  const std::string id = Identifier(set.name());
  const std::string guard = absl::AsciiStrToUpper(id) + "_H";
  std::string out = absl::StrFormat(
      "/* Gains K1..K5 of an orbital tracking control law, written by Orbitune.\n"
      " *   gain set          %s (%s)\n"
      " *   scenario          %s\n"
      " *   scenario digest   %s\n"
      " *   from              %s %s, iteration %d, %s, seed %u\n"
      " *   engine            Orbitune %s\n"
      " *   history digest    %s\n"
      " *   initial condition %s\n"
      " *   cost J %s, settling time %s s, delta-v %s m/s, peak acceleration %s m/s^2\n"
      " *   certificate: gains positive %s, domain guaranteed %s, V decreasing %s, settled %s\n"
      " */\n",
      InComment(set.name()), std::string(absl::StripPrefix(v1::GainSetKind_Name(set.kind()), "GAIN_SET_KIND_")),
      InComment(set.scenario()), InComment(set.scenario_digest()), InComment(set.job()), InComment(set.campaign()),
      set.iteration(), InComment(set.algorithm()), set.seed(), InComment(set.engine_version()),
      InComment(set.history_digest()), StateText(set.initial_condition()),
      set.flight().has_cost() ? RoundTrip(set.flight().cost()) : "none", RoundTrip(set.flight().settling_time_s()),
      RoundTrip(set.flight().delta_v_m_s()), RoundTrip(set.flight().peak_acceleration_m_s2()),
      set.flight().certificate().gains_positive() ? "yes" : "no",
      set.flight().certificate().domain_guaranteed() ? "yes" : "no",
      set.flight().certificate().lyapunov_decreasing() ? "yes" : "no",
      set.flight().certificate().settled() ? "yes" : "no");
  absl::StrAppend(&out, "#ifndef ", guard, "\n#define ", guard, "\n\n");
  absl::StrAppend(&out, "/* k1 in the velocity unit, k2..k5 in the acceleration unit. */\nstatic const double ", id,
                  "[5] = {\n");
  for (std::size_t i = 0; i < 5; ++i) {
    absl::StrAppend(
        &out, absl::StrFormat("    %a, /* k%d = %s */\n", values[i], static_cast<int>(i) + 1, RoundTrip(values[i])));
  }
  absl::StrAppend(
      &out, "};\n",
      absl::StrFormat("static const double %s_velocity_unit_m_s = %a; /* %s */\n", id, values[5], RoundTrip(values[5])),
      absl::StrFormat("static const double %s_acceleration_unit_m_s2 = %a; /* %s */\n", id, values[6],
                      RoundTrip(values[6])));
  absl::StrAppend(&out,
                  "/* CRC-32 (IEEE 802.3) of k1..k5 and the two units, in this order, as little-endian IEEE 754 "
                  "doubles: 56 bytes. */\nstatic const unsigned long ",
                  id, "_crc32 = 0x", Hex(Crc32(bytes)), "ul;\n\n#endif\n");
  return out;
}

absl::StatusOr<std::vector<ReadGainSet>> ReadGainSets(const std::string& path) {
  const auto text = ReadTextFile(path);
  if (!text.ok()) return text.status();
  auto sets = absl::EndsWith(path, ".json") ? ReadJson(path, *text) : ReadCsv(path, *text);
  if (sets.ok() && sets->empty()) return At(path, "there is no gain set in it");
  return sets;
}

}  // namespace orbitune::cli
