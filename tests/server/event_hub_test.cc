#include "server/jobs/event_hub.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <optional>
#include <semaphore>
#include <thread>
#include <vector>

namespace orbitune {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

JobEvent EventOf(std::int64_t seq) {
  JobEvent event{.seq = seq, .what = IterationRecord{}};
  std::get<IterationRecord>(event.what).iteration = static_cast<int>(seq);
  return event;
}

void PublishUpTo(EventHub& hub, const std::string& job, std::int64_t first, std::int64_t last) {
  for (std::int64_t seq = first; seq <= last; ++seq) hub.Publish(job, EventOf(seq));
}

std::vector<std::int64_t> Seqs(const EventHub::Recent& recent) {
  std::vector<std::int64_t> seqs;
  for (const EventHub::Event& event : recent.events) seqs.push_back(event->seq);
  return seqs;
}

TEST(EventHub, GivesEventsInOrderUpToTheLimit) {
  EventHub hub;
  PublishUpTo(hub, "a", 1, 5);
  hub.Publish("b", EventOf(1));
  EXPECT_THAT(Seqs(hub.After("a", 0, 100)), ElementsAre(1, 2, 3, 4, 5));
  EXPECT_THAT(Seqs(hub.After("a", 3, 100)), ElementsAre(4, 5));
  EXPECT_THAT(Seqs(hub.After("a", 1, 2)), ElementsAre(2, 3));
  EXPECT_TRUE(hub.After("a", 1, 2).complete);
  EXPECT_THAT(Seqs(hub.After("b", 0, 100)), ElementsAre(1));
}

TEST(EventHub, WhatIsNewestIsCompleteAndEmpty) {
  EventHub hub;
  PublishUpTo(hub, "a", 1, 3);
  for (const std::int64_t after : {3, 4}) {
    const EventHub::Recent recent = hub.After("a", after, 10);
    EXPECT_TRUE(recent.complete);
    EXPECT_THAT(recent.events, IsEmpty());
  }
}

TEST(EventHub, SaysWhenTheStoreHasToBeAsked) {
  EventHub hub(4);
  EXPECT_FALSE(hub.After("a", 0, 10).complete);
  PublishUpTo(hub, "a", 1, 10);  // 7 to 10 are kept
  EXPECT_FALSE(hub.After("a", 0, 10).complete);
  EXPECT_FALSE(hub.After("a", 5, 10).complete);
  EXPECT_THAT(hub.After("a", 5, 10).events, IsEmpty());
  EXPECT_TRUE(hub.After("a", 6, 10).complete);
  EXPECT_THAT(Seqs(hub.After("a", 6, 10)), ElementsAre(7, 8, 9, 10));
}

TEST(EventHub, AfterARestartItKnowsOnlyWhatCameSince) {
  EventHub hub;
  PublishUpTo(hub, "a", 41, 42);
  EXPECT_FALSE(hub.After("a", 39, 10).complete);
  EXPECT_THAT(Seqs(hub.After("a", 40, 10)), ElementsAre(41, 42));
}

TEST(EventHub, ForgetLetsGoOfEventsNotOfWatchers) {
  EventHub hub;
  int wakes = 0;
  const EventHub::Subscription subscription = hub.Subscribe("a", [&] { ++wakes; });
  PublishUpTo(hub, "a", 1, 2);
  hub.Forget("a");
  EXPECT_FALSE(hub.After("a", 2, 10).complete);
  hub.Publish("a", EventOf(3));
  EXPECT_EQ(wakes, 3);
  hub.Forget("none");
}

TEST(EventHub, WakesTheJobsOwnWatchersAfterTheEventIsThere) {
  EventHub hub;
  int a = 0;
  int b = 0;
  const auto of_a = hub.Subscribe("a", [&] { ++a; });
  std::optional<EventHub::Subscription> of_b = hub.Subscribe("b", [&] { ++b; });
  hub.Publish("a", EventOf(1));
  hub.Publish("b", EventOf(1));
  of_b.reset();
  hub.Publish("b", EventOf(2));
  EXPECT_EQ(a, 1);
  EXPECT_EQ(b, 1);
}

TEST(EventHub, AMovedSubscriptionIsOneSubscription) {
  EventHub hub;
  int wakes = 0;
  EventHub::Subscription kept;
  {
    EventHub::Subscription first = hub.Subscribe("a", [&] { ++wakes; });
    kept = std::move(first);
  }
  hub.Publish("a", EventOf(1));
  EXPECT_EQ(wakes, 1);
  kept = {};
  hub.Publish("a", EventOf(2));
  EXPECT_EQ(wakes, 1);
}

TEST(EventHub, OnDemandIsWokenOnceEveryTimeItAsks) {
  EventHub hub;
  int wakes = 0;
  const EventHub::Subscription subscription = hub.SubscribeOnDemand("a", [&] { ++wakes; });
  PublishUpTo(hub, "a", 1, 2);
  EXPECT_EQ(wakes, 0);
  EXPECT_EQ(subscription.publications(), 2);
  ASSERT_TRUE(subscription.WakeAtNext(2));
  ASSERT_TRUE(subscription.WakeAtNext(2));  // to ask again is to ask once
  hub.Publish("b", EventOf(1));
  EXPECT_EQ(wakes, 0);
  PublishUpTo(hub, "a", 3, 5);
  EXPECT_EQ(wakes, 1);
  ASSERT_TRUE(subscription.WakeAtNext(5));
  hub.Publish("a", EventOf(6));
  EXPECT_EQ(wakes, 2);
}

TEST(EventHub, OnDemandIsNotMadeToWaitForWhatHasBeenPublished) {
  EventHub hub;
  int wakes = 0;
  const EventHub::Subscription subscription = hub.SubscribeOnDemand("a", [&] { ++wakes; });
  PublishUpTo(hub, "a", 1, 3);
  EXPECT_FALSE(subscription.WakeAtNext(2));
  hub.Publish("a", EventOf(4));
  EXPECT_EQ(wakes, 0);
}

TEST(EventHub, ForgetAndTheEndOfOthersLeaveWhoeverAsked) {
  EventHub hub;
  int wakes = 0;
  const EventHub::Subscription subscription = hub.SubscribeOnDemand("a", [&] { ++wakes; });
  {
    const EventHub::Subscription other = hub.SubscribeOnDemand("a", [] { FAIL() << "its subscription has ended"; });
    hub.Publish("a", EventOf(1));
    ASSERT_TRUE(subscription.WakeAtNext(1));
    ASSERT_TRUE(other.WakeAtNext(1));
  }
  hub.Forget("a");
  hub.Publish("a", EventOf(2));
  EXPECT_EQ(wakes, 1);
}

// What the wake function uses may go as soon as the subscription has.
TEST(EventHub, NoWakeRunsOnceItsSubscriptionIsGone) {
  EventHub hub(8);
  std::atomic<bool> done = false;
  std::thread publisher([&] {
    for (std::int64_t seq = 1; !done; ++seq) {
      hub.Publish("a", EventOf(seq));
      // The lock is not a fair one.
      std::this_thread::yield();
    }
  });
  std::vector<std::thread> watchers;
  for (int i = 0; i < 3; ++i) {
    watchers.emplace_back([&] {
      for (int round = 0; round < 200; ++round) {
        auto counter = std::make_unique<int>(0);
        const auto wake = [&counter = *counter] { ++counter; };
        const bool on_demand = round % 2 == 0;
        const EventHub::Subscription subscription =
            on_demand ? hub.SubscribeOnDemand("a", wake) : hub.Subscribe("a", wake);
        if (on_demand) subscription.WakeAtNext(subscription.publications());
        hub.After("a", round, 4);
        if (round % 3 == 0) std::this_thread::yield();
      }  // the subscription goes first, then the counter
    });
  }
  for (std::thread& watcher : watchers) watcher.join();
  done = true;
  publisher.join();
}

// Every reader that follows the wakes sees every event once, whatever else goes on.
TEST(EventHub, ReadersBesideAPublisherMissNothing) {
  constexpr std::int64_t kEvents = 2000;
  EventHub hub(kEvents);
  std::vector<std::thread> readers;
  for (int i = 0; i < 3; ++i) {
    readers.emplace_back([&] {
      std::int64_t seen = 0;
      while (seen < kEvents) {
        for (const EventHub::Event& event : hub.After("a", seen, 16).events) ASSERT_EQ(event->seq, ++seen);
        std::this_thread::yield();
      }
    });
  }
  PublishUpTo(hub, "a", 1, kEvents);
  for (std::thread& reader : readers) reader.join();
}

// Whoever sleeps until it is woken sees every event, too.
TEST(EventHub, NoWakeAskedForIsLost) {
  constexpr std::int64_t kEvents = 2000;
  EventHub hub(kEvents);
  std::vector<std::thread> readers;
  for (int i = 0; i < 3; ++i) {
    readers.emplace_back([&] {
      std::counting_semaphore<> woken(0);
      const EventHub::Subscription subscription = hub.SubscribeOnDemand("a", [&] { woken.release(); });
      std::int64_t seen = 0;
      while (seen < kEvents) {
        const std::uint64_t publications = subscription.publications();
        for (const EventHub::Event& event : hub.After("a", seen, kEvents).events) ASSERT_EQ(event->seq, ++seen);
        if (seen < kEvents && subscription.WakeAtNext(publications)) {
          ASSERT_TRUE(woken.try_acquire_for(std::chrono::seconds(60))) << "after event " << seen;
        }
      }
    });
  }
  for (std::int64_t seq = 1; seq <= kEvents; ++seq) {
    hub.Publish("a", EventOf(seq));
    if (seq % 7 == 0) std::this_thread::yield();  // so that some fall asleep
  }
  for (std::thread& reader : readers) reader.join();
}

}  // namespace
}  // namespace orbitune
