// See ../README.md.
#pragma once
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace rclcpp
{
bool ok();

class Duration;
class Time
{
public:
  std::int64_t nanoseconds() const;
};

class Clock
{
public:
  using SharedPtr = std::shared_ptr<Clock>;
  Time now() const;
};

class Logger
{
};

class QoS
{
public:
  QoS & keep_last(std::size_t depth);
};
class SensorDataQoS : public QoS
{
};

class NodeOptions
{
public:
  NodeOptions & use_global_arguments(bool yes);
  template <typename T>
  NodeOptions & append_parameter_override(const std::string & name, const T & value);
};

template <typename M>
class Subscription
{
public:
  using SharedPtr = std::shared_ptr<Subscription>;
  std::size_t get_publisher_count() const;
};

class Node
{
public:
  using SharedPtr = std::shared_ptr<Node>;
  Node(const std::string & name, const std::string & name_space, const NodeOptions & options);
  Clock::SharedPtr get_clock();
  template <typename M>
  typename Subscription<M>::SharedPtr create_subscription(
    const std::string & topic, const QoS & qos, std::function<void(const M &)> callback);
};

namespace executors
{
class SingleThreadedExecutor
{
public:
  void add_node(Node::SharedPtr node, bool notify = true);
  void spin_once(std::chrono::nanoseconds timeout = std::chrono::nanoseconds(-1));
};
}  // namespace executors
}  // namespace rclcpp

#define RCLCPP_ERROR(logger, ...) (static_cast<void>(logger), static_cast<void>(std::snprintf(nullptr, 0, __VA_ARGS__)))
#include <cstdio>
