#include "tests/soak/sse_watchers.h"

#include <arpa/inet.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>

namespace orbitune::soak {
namespace {

// The text behind "name: ", up to the line's end; empty where there is none.
std::string FieldOf(const std::string& event, const std::string& name) {
  const std::size_t at = event.starts_with(name + ": ") ? 0 : event.find("\n" + name + ": ");
  if (at == event.npos) return "";
  const std::size_t begin = event.find(": ", at) + 2;
  return event.substr(begin, event.find('\n', begin) - begin);
}

// Of {"gap": {"first_seq": "12", ...}}.
std::int64_t FirstSeqOf(const std::string& event) {
  const std::size_t at = event.find("\"first_seq\":\"");
  return at == event.npos ? 0 : std::strtoll(event.c_str() + at + 13, nullptr, 10);
}

}  // namespace

struct SseWatchers::Watcher {
  Watcher(WatchedJob& j, bool e, int n)
      : job(j), every(e), number(n), check((e ? "SSE watcher " : "SSE watcher of the latest ") + std::to_string(n)) {}

  WatchedJob& job;
  const bool every;
  const int number;
  SequenceCheck check;
  int socket = -1;
  bool answered = false;  // 200
  bool ever_stalled = false;
  std::string text;
  Clock::time_point open_at;
};

SseWatchers::SseWatchers(std::string address, int count, std::vector<std::unique_ptr<WatchedJob>>& jobs,
                         Journal& journal)
    : address_(std::move(address)), journal_(journal), epoll_(epoll_create1(EPOLL_CLOEXEC)) {
  for (int i = 0; i < count; ++i) {
    watchers_.push_back(std::make_unique<Watcher>(*jobs[static_cast<std::size_t>(i) % jobs.size()], i % 2 == 0, i));
  }
  thread_ = std::thread([this] { Run(); });
}

SseWatchers::~SseWatchers() {
  Stop();
  close(epoll_);
}

void SseWatchers::Stop() {
  if (thread_.joinable()) thread_.join();
  for (const auto& watcher : watchers_) Close(*watcher);
}

void SseWatchers::Open(Watcher& watcher) {
  const std::size_t colon = address_.rfind(':');
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(std::stoi(address_.substr(colon + 1))));
  inet_pton(AF_INET, address_.substr(0, colon).c_str(), &to.sin_addr);
  watcher.socket = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const std::string request = "GET /v1/" + watcher.job.name +
                              ":watch?resume_after_seq=" + std::to_string(watcher.check.last()) +
                              (watcher.every ? "" : "&delivery=DELIVERY_LATEST") +
                              " HTTP/1.0\r\nHost: localhost\r\nAccept: text/event-stream\r\n\r\n";
  if (connect(watcher.socket, reinterpret_cast<sockaddr*>(&to), sizeof to) != 0 ||
      send(watcher.socket, request.data(), request.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(request.size())) {
    if (!journal_.restarting) journal_.Fault("an SSE watcher cannot connect");
    return Close(watcher);
  }
  watcher.answered = false;
  epoll_event event{.events = EPOLLIN, .data = {.ptr = &watcher}};
  epoll_ctl(epoll_, EPOLL_CTL_ADD, watcher.socket, &event);
}

void SseWatchers::Close(Watcher& watcher) {
  if (watcher.socket >= 0) close(watcher.socket);
  watcher.socket = -1;
  watcher.text.clear();
  watcher.open_at = Clock::now() + std::chrono::milliseconds(500);
}

// A watcher that stalls is out of the poll, its data left in the system's buffers, until it goes on.
void SseWatchers::Run() {
  epoll_event events[256];
  int stalled = 0;
  while (!journal_.stopping) {
    for (const auto& watcher : watchers_) {
      if (watcher->socket < 0 && Clock::now() >= watcher->open_at) Open(*watcher);
    }
    if (stalled != stalled_) {
      stalled = stalled_;
      for (const auto& watcher : watchers_) {
        const bool stalls = watcher->number < stalled;
        watcher->ever_stalled = watcher->ever_stalled || stalls;
        epoll_event event{.events = stalls ? 0U : EPOLLIN, .data = {.ptr = watcher.get()}};
        if (watcher->socket >= 0) epoll_ctl(epoll_, EPOLL_CTL_MOD, watcher->socket, &event);
      }
    }
    const int count = epoll_wait(epoll_, events, 256, 100);
    for (int i = 0; i < count; ++i) {
      auto& watcher = *static_cast<Watcher*>(events[i].data.ptr);
      if (watcher.number >= stalled) {
        Read(watcher);
      } else if ((events[i].events & (EPOLLHUP | EPOLLERR)) != 0) {
        ++journal_.cut_off;  // and a fresh one in its place, which stalls from its first byte
        Close(watcher);
        watcher.open_at = Clock::time_point::max();
      }
    }
    if (stalled == 0) {
      for (const auto& watcher : watchers_) {
        if (watcher->open_at == Clock::time_point::max()) watcher->open_at = Clock::now();
      }
    }
  }
}

void SseWatchers::Read(Watcher& watcher) {
  static thread_local char bytes[256 << 10];
  const ssize_t count = recv(watcher.socket, bytes, sizeof bytes, 0);
  if (count <= 0) {
    if (!journal_.restarting && !journal_.stopping && !watcher.ever_stalled) {
      journal_.Fault("an SSE watcher's connection ended");
    }
    return Close(watcher);
  }
  watcher.text.append(bytes, static_cast<std::size_t>(count));
  if (!watcher.answered) {
    const std::size_t end = watcher.text.find("\r\n\r\n");
    if (end == watcher.text.npos) return;
    if (watcher.text.find(" 200 ") > 16) {
      const bool known = watcher.text.find(" 429 ") < 16 || watcher.text.find(" 503 ") < 16;
      if (known) journal_.Refusal();
      if (!known) journal_.Fault("an SSE watcher was answered " + watcher.text.substr(0, 80));
      return Close(watcher);
    }
    watcher.answered = true;
    watcher.text.erase(0, end + 4);
  }
  std::size_t at = 0;
  for (std::size_t end; (end = watcher.text.find("\n\n", at)) != watcher.text.npos; at = end + 2) {
    Take(watcher, watcher.text.substr(at, end - at));
  }
  watcher.text.erase(0, at);
}

void SseWatchers::Take(Watcher& watcher, const std::string& event) {
  const std::string kind = FieldOf(event, "event");
  if (kind.empty() || kind == "snapshot") return;  // a comment
  if (kind == "error") {
    if (!journal_.restarting && !journal_.stopping) journal_.Fault("an SSE watcher was told " + event);
    return;
  }
  ++journal_.sse_events;
  const std::int64_t seq = std::strtoll(FieldOf(event, "id").c_str(), nullptr, 10);
  watcher.check.Take(kind == "gap" ? FirstSeqOf(event) : seq, seq, journal_);
  if (kind == "gap") return;
  const double behind_s = watcher.job.first_seen.Note(seq, Clock::now());
  if (behind_s > 0 && !watcher.ever_stalled) journal_.behind_first.Note(behind_s);
}

}  // namespace orbitune::soak
