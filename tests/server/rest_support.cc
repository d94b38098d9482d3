#include "tests/server/rest_support.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>

namespace orbitune::server_test {

namespace {

sockaddr_in SocketAddress(const std::string& host, const std::string& port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(std::stoi(port)));
  inet_pton(AF_INET, host.c_str(), &address.sin_addr);
  return address;
}

}  // namespace

HttpClient::HttpClient(const std::string& address, int receive_buffer, const std::string& from) {
  const std::size_t colon = address.rfind(':');
  const sockaddr_in to = SocketAddress(address.substr(0, colon), address.substr(colon + 1));
  socket_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (receive_buffer > 0) setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
  if (!from.empty()) {
    const sockaddr_in own = SocketAddress(from, "0");
    EXPECT_EQ(bind(socket_, reinterpret_cast<const sockaddr*>(&own), sizeof own), 0) << from;
  }
  EXPECT_EQ(connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof to), 0) << address;
}

HttpClient::~HttpClient() { close(socket_); }

bool HttpClient::Send(const std::string& bytes) {
  std::size_t sent = 0;
  while (sent < bytes.size()) {
    const ssize_t count = send(socket_, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
    if (count <= 0) return false;
    sent += static_cast<std::size_t>(count);
  }
  return true;
}

bool HttpClient::Fill() {
  pollfd wait{.fd = socket_, .events = POLLIN, .revents = 0};
  if (poll(&wait, 1, 60'000) != 1) {
    ADD_FAILURE() << "nothing comes";
    return false;
  }
  char bytes[64 << 10];
  const ssize_t count = recv(socket_, bytes, sizeof bytes, 0);
  if (count > 0) buffer_.append(bytes, static_cast<std::size_t>(count));
  return count > 0;
}

bool HttpClient::ReadLine(std::string* line) {
  std::size_t end = buffer_.find("\r\n");
  while (end == buffer_.npos) {
    if (!Fill()) return false;
    end = buffer_.find("\r\n");
  }
  *line = buffer_.substr(0, end);
  buffer_.erase(0, end + 2);
  return true;
}

HttpClient::Reply HttpClient::ReadHead() {
  Reply reply;
  std::string line;
  if (!ReadLine(&line) || line.size() < 12) return reply;
  EXPECT_EQ(line.substr(0, 7), "HTTP/1.");
  reply.code = std::stoi(line.substr(9, 3));
  while (ReadLine(&line) && !line.empty()) {
    const std::size_t colon = line.find(": ");
    std::string name = line.substr(0, colon);
    std::ranges::transform(name, name.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    reply.headers[name] = line.substr(std::min(colon + 2, line.size()));
  }
  return reply;
}

HttpClient::Reply HttpClient::ReadReply(bool head) {
  Reply reply = ReadHead();
  if (head || reply.code == 0 || reply.code == 204 || reply.code == 304) return reply;
  if (reply.headers.contains("content-length")) {
    const std::size_t length = std::stoul(reply.headers["content-length"]);
    while (buffer_.size() < length && Fill()) {
    }
    reply.body = buffer_.substr(0, length);
    EXPECT_EQ(reply.body.size(), length);
    buffer_.erase(0, length);
  } else {
    for (std::string chunk; ReadChunk(&chunk);) reply.body += chunk;
  }
  return reply;
}

bool HttpClient::ReadChunk(std::string* chunk) {
  std::string line;
  if (!ReadLine(&line)) return false;
  const std::size_t length = std::stoul(line, nullptr, 16);
  while (buffer_.size() < length + 2) {
    if (!Fill()) return false;
  }
  *chunk = buffer_.substr(0, length);
  buffer_.erase(0, length + 2);
  if (length == 0) ended_well_ = true;
  return length > 0;
}

bool HttpClient::Closes() {
  pollfd wait{.fd = socket_, .events = POLLIN, .revents = 0};
  char byte = 0;
  return buffer_.empty() && poll(&wait, 1, 60'000) == 1 && recv(socket_, &byte, 1, 0) <= 0;
}

HttpClient::Reply HttpClient::Call(const std::string& method, const std::string& target, const std::string& body,
                                   const std::string& headers) {
  std::string request = method + " " + target + " HTTP/1.1\r\nHost: localhost\r\n" + headers;
  if (!body.empty()) request += "Content-Length: " + std::to_string(body.size()) + "\r\n";
  Send(request + "\r\n" + body);
  return ReadReply(method == "HEAD");
}

EventStream::EventStream(const std::string& address, const std::string& target, bool sse, const std::string& headers,
                         int receive_buffer)
    : client_(address, receive_buffer), sse_(sse) {
  const std::string accept = sse ? "Accept: text/event-stream\r\n" : "Accept: application/x-ndjson\r\n";
  client_.Send("GET " + target + " HTTP/1.1\r\nHost: localhost\r\n" + accept + headers + "\r\n");
  head_ = client_.ReadHead();
  if (head_.code == 200) {
    EXPECT_EQ(head_.headers["content-type"], sse ? "text/event-stream" : "application/x-ndjson");
    EXPECT_EQ(head_.headers["transfer-encoding"], "chunked");
  }
}

bool EventStream::ReadLine(std::string* line) {
  std::size_t end = text_.find('\n', at_);
  while (end == text_.npos) {
    text_.erase(0, std::exchange(at_, 0));
    std::string chunk;
    if (head_.code != 200 || !client_.ReadChunk(&chunk)) return false;
    text_ += chunk;
    end = text_.find('\n');
  }
  *line = text_.substr(at_, end - at_);
  at_ = end + 1;
  return true;
}

bool EventStream::Read(StreamEvent* event) {
  *event = {};
  std::string line;
  while (ReadLine(&line)) {
    if (!sse_) {
      event->json = line;
      return true;
    }
    if (line.starts_with(":")) ++comments_;
    if (line.starts_with("id: ")) event->id = line.substr(4);
    if (line.starts_with("event: ")) event->kind = line.substr(7);
    if (line.starts_with("data: ")) event->json = line.substr(6);
    if (line.empty() && !event->json.empty()) return true;
  }
  return false;
}

std::vector<StreamEvent> EventStream::ReadAll() {
  std::vector<StreamEvent> events;
  for (StreamEvent event; Read(&event);) events.push_back(event);
  return events;
}

}  // namespace orbitune::server_test
