// What the tests over HTTP share: a client made of a socket, so that they can say exactly what goes over the wire.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "server/rest/server.h"

namespace orbitune::server_test {

// A connection. Everything waits; nothing is retried.
class HttpClient {
 public:
  // receive_buffer: of the socket, in bytes; 0: the system's. from: the client's own IP address; empty: the system's.
  explicit HttpClient(const std::string& address, int receive_buffer = 0, const std::string& from = "");
  ~HttpClient();
  HttpClient(const HttpClient&) = delete;
  HttpClient& operator=(const HttpClient&) = delete;

  struct Reply {
    int code = 0;                                // 0: the connection ended
    std::map<std::string, std::string> headers;  // names in lower case
    std::string body;
  };

  // False if the other side has closed.
  bool Send(const std::string& bytes);
  // A line without its end; false at the end.
  bool ReadLine(std::string* line);
  // Status line and headers.
  Reply ReadHead();
  // The whole reply. head: it has no body, whatever it says.
  Reply ReadReply(bool head = false);
  // Of a chunked body: false at its end.
  bool ReadChunk(std::string* chunk);
  // Whether a chunked body ended as it should.
  bool ended_well() const { return ended_well_; }
  // Whether the other side closes without another byte, within seconds.
  bool Closes();

  Reply Get(const std::string& target, const std::string& headers = "") { return Call("GET", target, "", headers); }
  Reply Post(const std::string& target, const std::string& json) {
    return Call("POST", target, json, "Content-Type: application/json\r\n");
  }
  // headers: whole lines. A body brings its Content-Length.
  Reply Call(const std::string& method, const std::string& target, const std::string& body = "",
             const std::string& headers = "");

 private:
  bool Fill();  // reads more; false at the end

  int socket_ = -1;
  std::string buffer_;
  bool ended_well_ = false;
};

// One event of a stream.
struct StreamEvent {
  std::string id;  // SSE only
  std::string kind;
  std::string json;
};

// A stream of events, as text/event-stream or a line each.
class EventStream {
 public:
  EventStream(const std::string& address, const std::string& target, bool sse, const std::string& headers = "",
              int receive_buffer = 0);

  const HttpClient::Reply& head() const { return head_; }
  // False at the end.
  bool Read(StreamEvent* event);
  std::vector<StreamEvent> ReadAll();
  bool ended_well() const { return client_.ended_well(); }
  int comments() const { return comments_; }

 private:
  bool ReadLine(std::string* line);

  HttpClient client_;
  const bool sse_;
  HttpClient::Reply head_;
  std::string text_;
  std::size_t at_ = 0;
  int comments_ = 0;
};

}  // namespace orbitune::server_test
