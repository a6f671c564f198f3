// See ../README.md.
#pragma once
#include <limits>
#include <map>
#include <memory>
#include <string>

#include "hardware_interface/types/hardware_component_interface_params.hpp"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/state.hpp"

namespace hardware_interface
{
enum class CallbackReturn : unsigned char { SUCCESS, FAILURE, ERROR };
enum class return_type : unsigned char { OK, ERROR, DEACTIVATE };

struct StateInterface
{
  using SharedPtr = std::shared_ptr<StateInterface>;
  double value = std::numeric_limits<double>::quiet_NaN();
  /// A reader holds it, as a controller in a thread of its own may.
  bool held = false;
};

class SensorInterface
{
public:
  virtual ~SensorInterface() = default;
  virtual CallbackReturn on_init(const HardwareComponentInterfaceParams & params)
  {
    info_ = params.hardware_info;
    for (const auto & sensor : info_.sensors) {
      for (const auto & interface : sensor.state_interfaces) {
        states[sensor.name + "/" + interface.name] = std::make_shared<StateInterface>();
      }
    }
    return CallbackReturn::SUCCESS;
  }
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) = 0;
  virtual CallbackReturn on_cleanup(const rclcpp_lifecycle::State &) = 0;
  virtual CallbackReturn on_shutdown(const rclcpp_lifecycle::State &) = 0;
  virtual CallbackReturn on_error(const rclcpp_lifecycle::State &) = 0;
  virtual return_type read(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;
  virtual const StateInterface::SharedPtr & get_state_interface_handle(const std::string & name) const
  {
    return states.at(name);
  }
  template <typename T>
  bool set_state(const StateInterface::SharedPtr & handle, const T & value, bool)
  {
    if (!handle->held) {
      handle->value = value;
    }
    return !handle->held;
  }
  virtual rclcpp::Logger get_logger() const { return {}; }

  std::map<std::string, StateInterface::SharedPtr> states;

protected:
  HardwareInfo info_;
};
}  // namespace hardware_interface
