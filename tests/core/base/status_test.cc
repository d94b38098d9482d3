#include "core/base/status.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <limits>

#include "core/base/check.h"

namespace orbitune {

bool operator==(const FieldViolation& a, const FieldViolation& b) {
  return a.field == b.field && a.description == b.description;
}

namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(FormatNumberTest, ReadsBackAsTheSameDouble) {
  for (const double value : {0.0, -0.0, 0.1, 1.0 / 3, 1e300, 5e-324, -123456789.125, 812.628}) {
    EXPECT_EQ(std::strtod(FormatNumber(value).c_str(), nullptr), value);
  }
  EXPECT_EQ(FormatNumber(0.1), "0.1");
  EXPECT_EQ(FormatNumber(std::numeric_limits<double>::infinity()), "inf");
  EXPECT_EQ(FormatNumber(std::nan("")), "nan");
}

TEST(FormatReceivedTest, QuotesAndReplacesControlCharacters) {
  EXPECT_EQ(FormatReceived("abc"), "\"abc\"");
  EXPECT_EQ(FormatReceived("a\nb\x1f"), "\"a?b?\"");
}

TEST(FormatReceivedTest, ShortensWithoutCuttingACharacter) {
  const std::string exact(80, 'x');
  EXPECT_EQ(FormatReceived(exact), '"' + exact + '"');
  EXPECT_EQ(FormatReceived(exact + 'x'), '"' + exact + "\"... (81 bytes)");
  // A two-byte character across the cut goes as a whole.
  EXPECT_EQ(FormatReceived(std::string(79, 'x') + "\xc3\xa9"), '"' + std::string(79, 'x') + "\"... (81 bytes)");
}

TEST(FieldErrorsTest, OkWhereNothingWasAdded) {
  EXPECT_TRUE(FieldErrors().ToStatus().ok());
  EXPECT_TRUE(FieldErrors().empty());
  EXPECT_THAT(FieldViolationsOf(absl::OkStatus()), IsEmpty());
}

TEST(FieldErrorsTest, KeepsEveryViolationInOrder) {
  FieldErrors errors;
  errors.AddNumber("p", "> 0", -1);
  errors.Add("name", "a word", FormatReceived("\x1e;"));
  const absl::Status status = errors.ToStatus();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(status.message(), "p: must be > 0, got -1; name: must be a word, got \"?;\"");
  EXPECT_THAT(FieldViolationsOf(status), ElementsAre(FieldViolation{"p", "must be > 0, got -1"},
                                                     FieldViolation{"name", "must be a word, got \"?;\""}));
}

TEST(FieldErrorsTest, MergePrefixesPaths) {
  FieldErrors outer;
  outer.Merge("target", absl::OkStatus());
  EXPECT_TRUE(outer.empty());
  outer.Merge("target", InvalidField("ex", "< 1", 2));
  outer.Merge("chaser", absl::NotFoundError("no such orbit"));
  EXPECT_THAT(FieldViolationsOf(outer.ToStatus()), ElementsAre(FieldViolation{"target.ex", "must be < 1, got 2"},
                                                               FieldViolation{"chaser", "no such orbit"}));
}

TEST(ReasonTest, TravelsWithTheStatus) {
  EXPECT_EQ(ReasonOf(WithReason(absl::AlreadyExistsError("x"), "REQUEST_ID_REUSED")), "REQUEST_ID_REUSED");
  EXPECT_EQ(ReasonOf(absl::AlreadyExistsError("x")), "");
  EXPECT_THAT(FieldViolationsOf(WithReason(absl::InternalError("x"), "R")), IsEmpty());
}

TEST(CheckDeathTest, SaysWhereAndEnds) {
  ORBITUNE_CHECK(1 + 1 == 2);
  EXPECT_DEATH(ORBITUNE_CHECK(1 + 1 == 3), "status_test.cc:.*check failed: 1 \\+ 1 == 3");
}

}  // namespace
}  // namespace orbitune
