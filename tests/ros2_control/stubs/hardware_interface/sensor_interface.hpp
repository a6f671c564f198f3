// See ../README.md.
#pragma once
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "hardware_interface/types/hardware_component_interface_params.hpp"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/state.hpp"

namespace hardware_interface
{
enum class CallbackReturn : unsigned char { SUCCESS, FAILURE, ERROR };
enum class return_type : unsigned char { OK, ERROR, DEACTIVATE };

struct InterfaceInfo
{
  std::string name;
};
struct ComponentInfo
{
  std::string name;
  std::vector<InterfaceInfo> state_interfaces;
};
struct HardwareInfo
{
  std::string name;
  std::unordered_map<std::string, std::string> hardware_parameters;
  std::vector<ComponentInfo> sensors;
};

class StateInterface
{
public:
  using SharedPtr = std::shared_ptr<StateInterface>;
};

class SensorInterface
{
public:
  virtual ~SensorInterface();
  virtual CallbackReturn on_init(const HardwareComponentInterfaceParams & params);
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State & before);
  virtual CallbackReturn on_cleanup(const rclcpp_lifecycle::State & before);
  virtual CallbackReturn on_shutdown(const rclcpp_lifecycle::State & before);
  virtual CallbackReturn on_error(const rclcpp_lifecycle::State & before);
  virtual return_type read(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;
  virtual const StateInterface::SharedPtr & get_state_interface_handle(const std::string & name) const;
  template <typename T>
  bool set_state(const StateInterface::SharedPtr & handle, const T & value, bool wait_until_set);
  virtual rclcpp::Logger get_logger() const;

protected:
  HardwareInfo info_;
};
}  // namespace hardware_interface
