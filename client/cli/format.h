// Values to text: short for people, full round trip for CSV.
#pragma once

#include <optional>
#include <string>

#include "google/protobuf/timestamp.pb.h"
#include "orbitune/v1/orbit.pb.h"
#include "orbitune/v1/simulation.pb.h"
#include "orbitune/v1/tuning.pb.h"

namespace orbitune::cli {

// The shortest text that reads back as the same double.
std::string RoundTrip(double value);

// At most `digits` significant digits; "-" for nothing.
std::string Human(double value, int digits = 6);
std::string Human(std::optional<double> value, int digits = 6);

// "82.5 %".
std::string Percent(std::optional<double> percent);

// How much less `cost` is than `first`, in percent of it. Nothing without both, or where first is 0.
std::optional<double> ReductionPercent(std::optional<double> first, std::optional<double> cost);

// "850 ms", "12.3 s", "2 min 5 s", "3 h 12 min".
std::string HumanDuration(double seconds);

// "2024-05-01T12:00:00Z", UTC, to the second.
std::string UtcTime(const google::protobuf::Timestamp& time);

double SecondsBetween(const google::protobuf::Timestamp& start, const google::protobuf::Timestamp& end);

// "0.1 1 1 1 10".
std::string GainsText(const v1::Gains& gains, int digits = 4);

std::string StateText(v1::JobState state);                 // "RUNNING"
std::string OutcomeText(v1::Outcome outcome);              // "not settled"
std::string GuaranteeText(v1::DomainGuarantee guarantee);  // "not guaranteed"

// Whether the job can change no more.
bool Ended(v1::JobState state);

// "Orbitune 0.1.0, avx2, multiply-add fused, glibc 2.36, ...".
std::string EngineText(const v1::Engine& engine);

// How many iterations the job will have at its end, as far as can be told: M, or fewer where max_episodes ends it.
int ExpectedIterations(const v1::Job& job);

// The options of the job's search, without those of the algorithms it does not use.
v1::Hyperparameters UsedHyperparameters(const v1::Job& job);

std::optional<double> CostOf(const v1::Iteration& iteration);

// Without control characters: what others wrote must not steer this terminal.
std::string Printable(const std::string& text);

}  // namespace orbitune::cli
