// JSON as it is written for streams, held against protobuf's own, byte for byte.
#include "server/api/json.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <random>

#include "orbitune/v1/campaign.pb.h"
#include "orbitune/v1/tuning.pb.h"
#include "tests/server/rpc_support.h"

namespace orbitune::server_test {
namespace {

void ExpectSame(const google::protobuf::Message& message) { EXPECT_EQ(ToJson(message), ToJsonByProtobuf(message)); }

v1::WatchJobResponse EventWith(double value) {
  v1::WatchJobResponse event;
  event.set_seq(1234567890123);
  v1::Iteration& iteration = *event.mutable_iteration();
  iteration.set_iteration(17);
  iteration.mutable_gains()->set_k1(value);
  iteration.set_fuel_sum(-value);
  iteration.set_outcome(v1::OUTCOME_NOT_SETTLED);
  iteration.set_cost(value);
  return event;
}

TEST(JsonTest, NumbersAreThoseOfProtobuf) {
  using Limits = std::numeric_limits<double>;
  for (const double value :
       {0.0, 1.0, 0.1, 1.0 / 3, 2.0 / 3, 100.0, 1e15, 1e16, 123456789012345678.0, 1e21, 1e-4, 1e-5, 0.3162277660168379,
        Limits::max(), Limits::min(), Limits::denorm_min(), 1e-310, Limits::infinity(), Limits::quiet_NaN()}) {
    ExpectSame(EventWith(value));
  }
  std::mt19937_64 random(1);
  for (int i = 0; i < 20'000; ++i) ExpectSame(EventWith(std::bit_cast<double>(random())));
  for (int i = 0; i < 5000; ++i) ExpectSame(EventWith(std::round(static_cast<double>(random() % 100'000'000)) / 1e4));
}

TEST(JsonTest, EveryKindOfEventIsThatOfProtobuf) {
  v1::WatchJobResponse event;
  ExpectSame(event);
  event.mutable_gap()->set_first_seq(3);
  ExpectSame(event);
  event.mutable_iteration();
  ExpectSame(event);
  event.mutable_iteration()->set_outcome(static_cast<v1::Outcome>(99));
  ExpectSame(event);
  event.mutable_state_change()->set_state(v1::JOB_STATE_SUCCEEDED);
  ExpectSame(event);
  event.mutable_state_change()->mutable_report()->mutable_initial()->mutable_gains()->set_k3(0.25);
  event.mutable_state_change()->mutable_report()->add_warnings()->set_message("plain");
  ExpectSame(event);
  event.mutable_state_change()->mutable_time()->set_seconds(1'700'000'000);
  ExpectSame(event);
  *event.mutable_snapshot() = CreateRequest(3).job();
  (*event.mutable_snapshot()->mutable_labels())["case"] = "one";
  ExpectSame(event);
  v1::WatchCampaignResponse ended;
  ended.mutable_member_ended()->add_episodes()->set_choice(v1::GAINS_CHOICE_TUNED);
  ended.mutable_member_ended()->mutable_initial_condition()->mutable_keplerian()->set_eccentricity(0.7306);
  ExpectSame(ended);
}

TEST(JsonTest, TextsAreThoseOfProtobuf) {
  for (const char* text :
       {"", "plain", "a \"b\" \\c", "<tag>", "\n\t\x01\x7f", "d\xc3\xa9j\xc3\xa0 \xe2\x80\xa8", "/'&"}) {
    v1::WatchJobResponse event;
    event.mutable_state_change()->set_message(text);
    ExpectSame(event);
  }
}

}  // namespace
}  // namespace orbitune::server_test
