// See ../README.md.
#pragma once
#include <any>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>

namespace rclcpp
{
inline bool ok() { return true; }

/// What a test holds instead of a network: subscriptions by topic, and how many publish on each.
struct Network
{
  static std::map<std::string, std::any> & subscriptions()
  {
    static std::map<std::string, std::any> all;
    return all;
  }
  static std::atomic<std::size_t> & publishers()
  {
    static std::atomic<std::size_t> count{1};
    return count;
  }
  template <typename M>
  static void publish(const std::string & topic, const M & message)
  {
    std::any_cast<std::function<void(const M &)> &>(subscriptions().at(topic))(message);
  }
};

class Duration
{
};
class Time
{
public:
  explicit Time(std::int64_t ns = 0) : ns_(ns) {}
  std::int64_t nanoseconds() const { return ns_; }

private:
  std::int64_t ns_;
};

class Clock
{
public:
  using SharedPtr = std::shared_ptr<Clock>;
  Time now() const
  {
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    return Time(std::chrono::duration_cast<std::chrono::nanoseconds>(now).count());
  }
};

class Logger
{
};

class QoS
{
public:
  QoS & keep_last(std::size_t) { return *this; }
};
class SensorDataQoS : public QoS
{
};

class NodeOptions
{
public:
  NodeOptions & use_global_arguments(bool) { return *this; }
  template <typename T>
  NodeOptions & append_parameter_override(const std::string &, const T &)
  {
    return *this;
  }
};

template <typename M>
class Subscription
{
public:
  using SharedPtr = std::shared_ptr<Subscription>;
  explicit Subscription(std::string topic) : topic_(std::move(topic)) {}
  ~Subscription() { Network::subscriptions().erase(topic_); }
  std::size_t get_publisher_count() const { return Network::publishers().load(); }

private:
  std::string topic_;
};

class Node
{
public:
  using SharedPtr = std::shared_ptr<Node>;
  Node(const std::string &, const std::string & name_space, const NodeOptions &) : name_space_(name_space) {}
  Clock::SharedPtr get_clock() { return std::make_shared<Clock>(); }
  template <typename M>
  typename Subscription<M>::SharedPtr create_subscription(
    const std::string & topic, const QoS &, std::function<void(const M &)> callback)
  {
    const auto name = name_space_ + topic;
    Network::subscriptions()[name] = callback;
    return std::make_shared<Subscription<M>>(name);
  }

private:
  std::string name_space_;
};

namespace executors
{
class SingleThreadedExecutor
{
public:
  void add_node(Node::SharedPtr, bool = true) {}
  void spin_once(std::chrono::nanoseconds) { std::this_thread::sleep_for(std::chrono::milliseconds(1)); }
};
}  // namespace executors
}  // namespace rclcpp

#define RCLCPP_ERROR(logger, ...) (static_cast<void>(logger), static_cast<void>(std::snprintf(nullptr, 0, __VA_ARGS__)))
