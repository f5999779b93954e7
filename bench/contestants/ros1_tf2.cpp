// Owns the calls of ROS 1's tf2 for C++; takes the orders that serving.py describes.
#include <geometry_msgs/TransformStamped.h>
#include <malloc.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;

const char AUTHORITY[] = "bench";
const uint64_t S = 1000000000;
const uint64_t STEP_NS = 10000000;

struct Record {
  uint32_t child, parent, is_static, reserved;
  int64_t stamp_ns;
  double pose[7];
};
static_assert(sizeof(Record) == 80, "as serving.py packs it");

struct Query {
  uint32_t target, source;
  int64_t time_ns;
};
static_assert(sizeof(Query) == 16, "as serving.py packs it");

struct Call {
  std::string target, source;
  ros::Time time;
};

struct Set {
  std::shared_ptr<tf2::BufferCore> buffer;
  std::vector<Call> calls;
};

ros::Time time_of(int64_t ns) { return ros::Time(ns / S, ns % S); }

int64_t since(Clock::time_point start) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now() - start).count();
}

int64_t rss_bytes() {
  malloc_trim(0);
  std::ifstream file("/proc/self/statm");
  int64_t size = 0, resident = 0;
  file >> size >> resident;
  return resident * sysconf(_SC_PAGESIZE);
}

class Contestant {
 public:
  std::string about() const {
    std::ostringstream out;
    out << "{\"version\": \"" << std::getenv("BENCH_VERSION")
        << "\", \"python\": null, \"returns\": \"geometry_msgs::TransformStamped (ROS 1)\"}";
    return out.str();
  }

  std::string load(const std::string& path, bool keep) {
    if (!keep) sets_.clear();
    buffer_.reset();
    const int64_t before = rss_bytes();
    const auto start = Clock::now();
    std::ifstream file(path, std::ios::binary);
    size_t name_count = 0, record_count = 0;
    int64_t cache_ns = 0, newest_ns = 0;
    file >> name_count >> record_count >> cache_ns >> newest_ns;
    file.ignore();
    names_.resize(name_count);
    for (auto& name : names_) std::getline(file, name);
    buffer_.reset(new tf2::BufferCore(ros::Duration(cache_ns / S, cache_ns % S)));
    moving_.clear();
    std::set<uint32_t> seen;
    geometry_msgs::TransformStamped message;
    Record record;
    for (size_t i = 0; i < record_count; ++i) {
      if (!file.read(reinterpret_cast<char*>(&record), sizeof record)) throw std::runtime_error("a short file");
      fill(record, &message);
      buffer_->setTransform(message, AUTHORITY, record.is_static);
      if (!record.is_static && seen.insert(record.child).second) moving_.push_back(record);
    }
    next_ns_ = newest_ns + 2 * STEP_NS;
    std::ostringstream out;
    out << "{\"seconds\": " << since(start) / 1e9 << ", \"rss_bytes\": " << rss_bytes() - before << "}";
    return out.str();
  }

  std::string aim(const std::string& set, const std::string& path, int check) {
    std::ifstream file(path, std::ios::binary);
    std::vector<Call> calls;
    Query query;
    while (file.read(reinterpret_cast<char*>(&query), sizeof query))
      calls.push_back({names_.at(query.target), names_.at(query.source), time_of(query.time_ns)});
    std::ostringstream out;
    out.precision(17);
    out << "{\"answers\": [";
    for (size_t i = 0; i < std::min<size_t>(check, calls.size()); ++i) {
      if (i) out << ", ";
      try {
        const auto transform =
            buffer_->lookupTransform(calls[i].target, calls[i].source, calls[i].time).transform;
        const auto& t = transform.translation;
        const auto& q = transform.rotation;
        out << "[" << t.x << ", " << t.y << ", " << t.z << ", " << q.x << ", " << q.y << ", " << q.z << ", " << q.w
            << "]";
      } catch (const tf2::TransformException&) {
        out << "null";
      }
    }
    out << "]}";
    sets_[set] = {buffer_, calls};
    return out.str();
  }

  std::string time(const std::string& set, size_t count, double budget_s) {
    const auto& calls = sets_.at(set).calls;
    auto& buffer = *sets_.at(set).buffer;
    const std::vector<int64_t> empty = time_nothing();
    // Others have run since, and the caches of the machine have forgotten these queries.
    std::vector<int64_t> forgotten, times;
    size_t failed = 0, ignored = 0;
    run(buffer, calls, std::min(count, calls.size()), budget_s / 2, &forgotten, &ignored);
    run(buffer, calls, count, budget_s, &times, &failed);
    return told(times, failed, empty);
  }

  std::string insert(size_t count, double budget_s) {
    std::vector<geometry_msgs::TransformStamped> messages;
    while (messages.size() < count) {
      for (Record record : moving_) {
        record.stamp_ns = next_ns_;
        messages.emplace_back();
        fill(record, &messages.back());
      }
      next_ns_ += STEP_NS;
    }
    const auto began = Clock::now();
    std::vector<int64_t> empty = time_nothing(), times;
    times.reserve(messages.size());
    size_t failed = 0;
    for (const auto& message : messages) {
      if (since(began) > budget_s * 1e9) break;
      const auto start = Clock::now();
      const bool taken = buffer_->setTransform(message, AUTHORITY);
      const int64_t ns = since(start);
      if (taken) times.push_back(ns);
      else ++failed;
    }
    return told(times, failed, empty);
  }

 private:
  static void run(const tf2::BufferCore& buffer, const std::vector<Call>& calls, size_t count, double budget_s,
                  std::vector<int64_t>* times, size_t* failed) {
    const auto began = Clock::now();
    times->reserve(count);
    for (size_t i = 0; i < count && since(began) < budget_s * 1e9; ++i) {
      const Call& call = calls[i % calls.size()];
      bool answered = true;
      const auto start = Clock::now();
      try {
        // The answer is made and dropped within the time, as a caller's would be.
        const geometry_msgs::TransformStamped answer = buffer.lookupTransform(call.target, call.source, call.time);
        asm volatile("" : : "g"(&answer) : "memory");
      } catch (const tf2::TransformException&) {
        answered = false;
      }
      const int64_t ns = since(start);
      if (answered) times->push_back(ns);
      else ++*failed;
    }
  }

  void fill(const Record& record, geometry_msgs::TransformStamped* message) const {
    message->header.frame_id = names_.at(record.parent);
    message->child_frame_id = names_.at(record.child);
    message->header.stamp = time_of(record.stamp_ns);
    auto& t = message->transform.translation;
    auto& q = message->transform.rotation;
    t.x = record.pose[0], t.y = record.pose[1], t.z = record.pose[2];
    q.x = record.pose[3], q.y = record.pose[4], q.z = record.pose[5], q.w = record.pose[6];
  }

  static std::vector<int64_t> time_nothing() {
    std::vector<int64_t> times;
    for (int i = 0; i < 1000; ++i) {
      const auto start = Clock::now();
      asm volatile("" : : : "memory");
      times.push_back(since(start));
    }
    return times;
  }

  static std::string told(const std::vector<int64_t>& times, size_t failed, std::vector<int64_t> empty) {
    std::nth_element(empty.begin(), empty.begin() + empty.size() / 2, empty.end());
    std::ostringstream out;
    out << "{\"ns\": [";
    for (size_t i = 0; i < times.size(); ++i) out << (i ? ", " : "") << times[i];
    out << "], \"failed\": " << failed << ", \"empty_ns\": " << empty[empty.size() / 2] << ", \"batch\": 1}";
    return out.str();
  }

  std::vector<std::string> names_;
  std::shared_ptr<tf2::BufferCore> buffer_;
  std::map<std::string, Set> sets_;
  std::vector<Record> moving_;  // the first record of each dynamic frame
  int64_t next_ns_ = 0;
};

std::string obey(Contestant* contestant, const std::vector<std::string>& words) {
  const std::string& order = words.at(0);
  if (order == "about") return contestant->about();
  if (order == "load") return contestant->load(words.at(1), words.at(2) == "1");
  if (order == "aim") return contestant->aim(words.at(2), words.at(3), std::stoi(words.at(4)));
  if (order == "time") return contestant->time(words.at(2), std::stoul(words.at(3)), std::stod(words.at(4)));
  if (order == "insert") return contestant->insert(std::stoul(words.at(2)), std::stod(words.at(3)));
  throw std::runtime_error("no such order: " + order);
}

}  // namespace

int main() {
  Contestant contestant;
  std::string line;
  while (std::getline(std::cin, line)) {
    std::vector<std::string> words;
    std::istringstream stream(line);
    for (std::string word; std::getline(stream, word, '\t');) words.push_back(word);
    try {
      std::cout << obey(&contestant, words) << std::endl;
    } catch (const std::exception& error) {
      std::cout << "{\"error\": \"" << error.what() << "\"}" << std::endl;
    }
  }
}
