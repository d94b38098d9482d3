#include "server/log/log.h"

#include <gtest/gtest.h>

#include <vector>

namespace orbitune {
namespace {

constexpr std::int64_t kTime_us = 1'700'000'000'000'042;

TEST(LogTest, ALineIsTimeLevelMessageAndFields) {
  EXPECT_EQ(FormatLogLine(false, kTime_us, LogLevel::kInfo, "job ended",
                          {{"job", "abc"}, {"iterations", 12}, {"seconds", 0.5}, {"error", ""}}),
            "2023-11-14T22:13:20.000042Z info job ended job=abc iterations=12 seconds=0.5");
  EXPECT_EQ(FormatLogLine(true, kTime_us, LogLevel::kError, "job ended",
                          {{"job", "abc"}, {"iterations", 12}, {"seconds", 0.5}, {"error", ""}}),
            "{\"time\":\"2023-11-14T22:13:20.000042Z\",\"level\":\"error\",\"message\":\"job ended\",\"job\":\"abc\","
            "\"iterations\":12,\"seconds\":0.5}");
}

// Whatever comes in, it is one line, and no field passes for another.
TEST(LogTest, WhatIsNoPlainWordIsQuoted) {
  EXPECT_EQ(FormatLogLine(false, kTime_us, LogLevel::kWarning, "m", {{"error", "a b=c\n\"d\"\x01"}, {"k", "x=y"}}),
            "2023-11-14T22:13:20.000042Z warning m error=\"a b=c\\u000a\\\"d\\\"\\u0001\" k=\"x=y\"");
  EXPECT_EQ(FormatLogLine(true, kTime_us, LogLevel::kDebug, "a\nb", {{"k", "\\"}}),
            "{\"time\":\"2023-11-14T22:13:20.000042Z\",\"level\":\"debug\",\"message\":\"a\\u000ab\",\"k\":\"\\\\\"}");
}

TEST(LogTest, LeavesOutWhatIsLessSerious) {
  std::vector<std::string> lines;
  SetUpLog(
      {.level = LogLevel::kWarning, .json = false, .sink = [&](const std::string& line) { lines.push_back(line); }});
  Log(LogLevel::kInfo, "no");
  Log(LogLevel::kWarning, "yes", {{"n", 1}});
  EXPECT_FALSE(IsLogged(LogLevel::kDebug));
  EXPECT_TRUE(IsLogged(LogLevel::kError));
  SetUpLog({});
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_TRUE(lines[0].ends_with(" warning yes n=1")) << lines[0];
}

TEST(LogTest, LevelsHaveNames) {
  for (const LogLevel level : {LogLevel::kDebug, LogLevel::kInfo, LogLevel::kWarning, LogLevel::kError}) {
    EXPECT_EQ(LogLevelFrom(NameOf(level)), level);
  }
  EXPECT_FALSE(LogLevelFrom("loud"));
}

}  // namespace
}  // namespace orbitune
