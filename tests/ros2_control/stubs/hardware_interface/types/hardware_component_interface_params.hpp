// See ../../README.md.
#pragma once
namespace hardware_interface
{
struct HardwareComponentInterfaceParams
{
};
}  // namespace hardware_interface
