// See ../../README.md.
#pragma once
#include <string>
#include <unordered_map>
#include <vector>

namespace hardware_interface
{
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
struct HardwareComponentInterfaceParams
{
  HardwareInfo hardware_info;
};
}  // namespace hardware_interface
