// Gain sets as files: CSV and JSON to be read back, and a C header to fly with.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "orbitune/v1/gains.pb.h"

namespace orbitune::cli {

// CRC-32 as of IEEE 802.3 (zlib's).
std::uint32_t Crc32(std::string_view bytes);

// Lines without their end. The last column is the CRC-32 of the row before its last comma, in eight hex digits.
std::string GainSetCsvHeader();
std::string GainSetCsvRow(const v1::GainSet& set);

v1::GainSetFile ToGainSetFile(const std::vector<v1::GainSet>& sets);

// C99 and C++17: the gains as hexadecimal floating point, what their units are, where they come from, and the CRC-32 of
// the seven doubles k1..k5, velocity unit, acceleration unit, little-endian.
std::string GainSetCHeader(const v1::GainSet& set);

struct ReadGainSet {
  v1::GainSet set;
  std::string where;  // "FILE:3", "FILE: gain_sets[2]"
};
// A *.json as GainSetFile, else CSV whose columns, named by its first line, may come in any order and be left out but
// for scenario, k1..k5 and initial_condition. INVALID_ARGUMENT naming file, line and column for the first fault: what
// cannot be read, and a checksum that is not the row's.
absl::StatusOr<std::vector<ReadGainSet>> ReadGainSets(const std::string& path);

}  // namespace orbitune::cli
