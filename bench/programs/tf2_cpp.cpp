// SPDX-FileCopyrightText: tf2-ros-cython contributors
// SPDX-License-Identifier: BSD-3-Clause

// The timed loops around tf2 for C++, as a library that tf2_cpp_library.py loads.
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include <geometry_msgs/msg/transform_stamped.hpp>

const int64_t S = 1000000000;

using Message = geometry_msgs::msg::TransformStamped;
using Time = tf2::TimePoint;
using Duration = tf2::Duration;
Time time_of(int64_t ns) { return Time(std::chrono::nanoseconds(ns)); }
Duration duration_of(int64_t ns) { return std::chrono::nanoseconds(ns); }
builtin_interfaces::msg::Time stamp_of(int64_t ns) {
  builtin_interfaces::msg::Time stamp;
  stamp.sec = ns / S;
  stamp.nanosec = ns % S;
  return stamp;
}

// As trees_and_queries.py has them; frames by index.
struct Record {
  uint32_t child, parent, is_static, reserved;
  int64_t stamp_ns;
  double pose[7];  // x y z, qx qy qz qw
};
static_assert(sizeof(Record) == 80, "as in trees_and_queries.py");

struct Query {
  uint32_t target, source;
  int64_t time_ns;
};
static_assert(sizeof(Query) == 16, "as in trees_and_queries.py");

struct Buffer {
  tf2::BufferCore core;
  std::vector<std::string> names;
};

namespace {

using Clock = std::chrono::steady_clock;

const char AUTHORITY[] = "bench";
const int64_t REFUSED = -1;

struct Call {
  std::string target, source;
  Time time;
};

int64_t since(Clock::time_point start) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now() - start).count();
}

Message message_of(const Buffer& buffer, const Record& record) {
  Message message;
  message.header.frame_id = buffer.names.at(record.parent);
  message.child_frame_id = buffer.names.at(record.child);
  message.header.stamp = stamp_of(record.stamp_ns);
  auto& t = message.transform.translation;
  auto& q = message.transform.rotation;
  t.x = record.pose[0], t.y = record.pose[1], t.z = record.pose[2];
  q.x = record.pose[3], q.y = record.pose[4], q.z = record.pose[5], q.w = record.pose[6];
  return message;
}

Call call_of(const Buffer& buffer, const Query& query) {
  return {buffer.names.at(query.target), buffer.names.at(query.source), time_of(query.time_ns)};
}

}  // namespace

extern "C" {

Buffer* buffer_new(int64_t cache_ns, const char* const* names, size_t count) {
  return new Buffer{tf2::BufferCore(duration_of(cache_ns)), {names, names + count}};
}

void buffer_free(Buffer* buffer) { delete buffer; }

// ns[i] becomes what insert i takes, or REFUSED. Returns how many inserts the budget allowed.
size_t buffer_insert(Buffer* buffer, const Record* records, size_t count, double budget_s, int64_t* ns) {
  std::vector<Message> messages;
  for (size_t i = 0; i < count; ++i) messages.push_back(message_of(*buffer, records[i]));
  const auto began = Clock::now();
  size_t i = 0;
  for (; i < count && since(began) < budget_s * S; ++i) {
    const auto start = Clock::now();
    const bool inserted = buffer->core.setTransform(messages[i], AUTHORITY, records[i].is_static);
    ns[i] = since(start);
    if (!inserted) ns[i] = REFUSED;
  }
  return i;
}

// As buffer_insert, for `count` lookups, of the queries in turn.
size_t buffer_look_up(const Buffer* buffer, const Query* queries, size_t query_count, size_t count, double budget_s,
                      int64_t* ns) {
  std::vector<Call> calls;
  for (size_t i = 0; i < query_count; ++i) calls.push_back(call_of(*buffer, queries[i]));
  const auto began = Clock::now();
  size_t i = 0;
  for (; i < count && since(began) < budget_s * S; ++i) {
    const Call& call = calls[i % query_count];
    bool answered = true;
    const auto start = Clock::now();
    try {
      // The answer is made and dropped within the time, as a caller's would be.
      const Message answer = buffer->core.lookupTransform(call.target, call.source, call.time);
      asm volatile("" : : "g"(&answer) : "memory");
    } catch (const tf2::TransformException&) {
      answered = false;
    }
    ns[i] = since(start);
    if (!answered) ns[i] = REFUSED;
  }
  return i;
}

// The loop without the call.
void time_nothing(size_t count, int64_t* ns) {
  for (size_t i = 0; i < count; ++i) {
    const auto start = Clock::now();
    asm volatile("" : : : "memory");
    ns[i] = since(start);
  }
}
}
