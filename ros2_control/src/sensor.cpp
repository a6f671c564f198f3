// The twin as a sensor of ros2_control.

#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <exception>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "geometry_msgs/msg/wrench_stamped.hpp"
#include "hardware_interface/sensor_interface.hpp"
#include "hardware_interface/types/hardware_component_interface_params.hpp"
#include "needle_twin/msg/safety.hpp"
#include "needle_twin_control/latest.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/state.hpp"

namespace needle_twin_control
{

namespace
{

/// Names of the state interfaces, in the order of a State.
constexpr std::array<const char *, 7> kInterfaces{
  "force.x", "force.y", "force.z", "torque.x", "torque.y", "torque.z", "safe"};

std::int64_t arrivals_ns()
{
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
}

}  // namespace

class TwinSensor : public hardware_interface::SensorInterface
{
public:
  using CallbackReturn = hardware_interface::CallbackReturn;

  ~TwinSensor() override { stop(); }

  CallbackReturn on_init(const hardware_interface::HardwareComponentInterfaceParams & params) override
  {
    if (hardware_interface::SensorInterface::on_init(params) != CallbackReturn::SUCCESS) {
      return CallbackReturn::ERROR;
    }
    if (info_.sensors.size() != 1) {
      RCLCPP_ERROR(get_logger(), "one <sensor> is needed, with the state interfaces force.x to torque.z and safe");
      return CallbackReturn::ERROR;
    }
    for (const auto & interface : info_.sensors[0].state_interfaces) {
      bool known = false;
      for (const auto * name : kInterfaces) {
        known = known || interface.name == name;
      }
      if (!known) {
        RCLCPP_ERROR(
          get_logger(), "state interface %s: there are force.x, .y, .z, torque.x, .y, .z and safe",
          interface.name.c_str());
        return CallbackReturn::ERROR;
      }
    }
    try {
      timeout_s_ = std::stod(parameter("timeout_s", "0.025"));
    } catch (const std::exception &) {
      timeout_s_ = 0.0;
    }
    if (!(timeout_s_ > 0.0 && timeout_s_ <= 3600.0)) {
      RCLCPP_ERROR(get_logger(), "timeout_s is a number of seconds above 0, at most 3600");
      return CallbackReturn::ERROR;
    }
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_configure(const rclcpp_lifecycle::State &) override
  {
    stop();
    for (const auto & interface : info_.sensors[0].state_interfaces) {
      for (std::size_t i = 0; i < kInterfaces.size(); ++i) {
        if (interface.name == kInterfaces[i]) {
          handles_[i] = get_state_interface_handle(info_.sensors[0].name + "/" + interface.name);
        }
      }
    }
    latest_ = std::make_unique<Latest>(static_cast<std::int64_t>(std::llround(1e9 * timeout_s_)));
    // A node of its own: the controller manager's arguments would rename it, and its executor may be busy.
    rclcpp::NodeOptions options;
    options.use_global_arguments(false);
    options.append_parameter_override("use_sim_time", parameter("use_sim_time", "false") == "true");
    node_ = std::make_shared<rclcpp::Node>(info_.name + "_listener", parameter("namespace", "/"), options);
    clock_ = node_->get_clock();
    const auto newest = rclcpp::SensorDataQoS().keep_last(1);
    force_ = node_->create_subscription<geometry_msgs::msg::WrenchStamped>(
      parameter("force_topic", "predicted_cf"), newest, [this](const geometry_msgs::msg::WrenchStamped & message) {
        const auto & force = message.wrench.force;
        const auto & torque = message.wrench.torque;
        latest_->predicted(
          {{arrivals_ns(), stamp_ns(message.header.stamp)}, {force.x, force.y, force.z, torque.x, torque.y, torque.z}});
      });
    safety_ = node_->create_subscription<needle_twin::msg::Safety>(
      parameter("safety_topic", "safety"), newest, [this](const needle_twin::msg::Safety & message) {
        latest_->judged({{arrivals_ns(), stamp_ns(message.header.stamp)}, message.safe});
      });
    leave_.store(false);
    thread_ = std::thread([this] { listen(); });
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_cleanup(const rclcpp_lifecycle::State &) override { return stopped(); }
  CallbackReturn on_shutdown(const rclcpp_lifecycle::State &) override { return stopped(); }
  CallbackReturn on_error(const rclcpp_lifecycle::State &) override { return stopped(); }

  hardware_interface::return_type read(const rclcpp::Time &, const rclcpp::Duration &) override
  {
    if (!latest_) {
      return hardware_interface::return_type::OK;
    }
    // The time that the controller manager hands over may be of a clock without a date.
    const auto [wrench, safe] = latest_->read(arrivals_ns(), clock_->now().nanoseconds());
    const std::array<double, 7> values{wrench[0], wrench[1], wrench[2], wrench[3], wrench[4], wrench[5], safe};
    bool all = true;
    for (std::size_t i = 0; i < values.size(); ++i) {
      all = all && show(handles_[i], values[i]);
    }
    // A value that could not be set is an old one, which may be a yes.
    return all ? hardware_interface::return_type::OK : hardware_interface::return_type::ERROR;
  }

private:
  std::string parameter(const std::string & name, const std::string & otherwise) const
  {
    const auto found = info_.hardware_parameters.find(name);
    return found == info_.hardware_parameters.end() ? otherwise : found->second;
  }

  template <typename Stamp>
  static std::int64_t stamp_ns(const Stamp & stamp)
  {
    return std::int64_t{1000000000} * stamp.sec + stamp.nanosec;
  }

  /// Sets a state without waiting; a controller in another thread that reads it at this moment is a matter of nanoseconds.
  bool show(const hardware_interface::StateInterface::SharedPtr & handle, double value)
  {
    for (int attempt = 0; handle && attempt < 1000; ++attempt) {
      if (set_state(handle, value, false)) {
        return true;
      }
    }
    return !handle;
  }

  void listen()
  {
    rclcpp::executors::SingleThreadedExecutor executor;
    executor.add_node(node_);
    std::int64_t counted_ns = 0;
    while (rclcpp::ok() && !leave_.load()) {
      executor.spin_once(std::chrono::milliseconds(50));
      if (arrivals_ns() - counted_ns > 100'000'000) {
        counted_ns = arrivals_ns();
        latest_->contested(force_->get_publisher_count() > 1 || safety_->get_publisher_count() > 1);
      }
    }
  }

  CallbackReturn stopped()
  {
    stop();
    return CallbackReturn::SUCCESS;
  }

  void stop()
  {
    leave_.store(true);
    if (thread_.joinable()) {
      thread_.join();
    }
    force_.reset();
    safety_.reset();
    clock_.reset();
    node_.reset();
    latest_.reset();
    for (std::size_t i = 0; i < handles_.size(); ++i) {
      show(handles_[i], i < 6 ? std::numeric_limits<double>::quiet_NaN() : 0.0);
    }
  }

  double timeout_s_ = 0.025;
  std::array<hardware_interface::StateInterface::SharedPtr, 7> handles_;
  std::unique_ptr<Latest> latest_;
  rclcpp::Node::SharedPtr node_;
  rclcpp::Clock::SharedPtr clock_;
  rclcpp::Subscription<geometry_msgs::msg::WrenchStamped>::SharedPtr force_;
  rclcpp::Subscription<needle_twin::msg::Safety>::SharedPtr safety_;
  std::atomic<bool> leave_{true};
  std::thread thread_;
};

}  // namespace needle_twin_control

PLUGINLIB_EXPORT_CLASS(needle_twin_control::TwinSensor, hardware_interface::SensorInterface)
