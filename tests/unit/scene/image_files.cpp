#include "scene/image_files.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <stdexcept>

namespace fogbank::scene::test {

template <class Value>
std::string image_file(const std::string& format, int width, int height, const std::vector<Value>& values,
                       const std::vector<std::string>& channel_names) {
  const OIIO::TypeDesc type = OIIO::BaseTypeFromC<Value>::value;
  const auto texels = static_cast<size_t>(width) * static_cast<size_t>(height);
  OIIO::ImageSpec spec(width, height, static_cast<int>(values.size() / texels), type);
  if (!channel_names.empty()) spec.channelnames = channel_names;
  spec.attribute("oiio:UnassociatedAlpha", 1);
  std::vector<unsigned char> buffer;
  OIIO::Filesystem::IOVecOutput memory(buffer);
  const auto output = OIIO::ImageOutput::create(format, &memory);
  if (output == nullptr || !output->open("memory." + format, spec) ||
      !output->write_image(type, values.data()) || !output->close())
    throw std::runtime_error("can't make a test image: " + (output ? output->geterror() : format));
  return {buffer.begin(), buffer.end()};
}

template std::string image_file(const std::string&, int, int, const std::vector<uint8_t>&,
                                const std::vector<std::string>&);
template std::string image_file(const std::string&, int, int, const std::vector<uint16_t>&,
                                const std::vector<std::string>&);
template std::string image_file(const std::string&, int, int, const std::vector<float>&,
                                const std::vector<std::string>&);

}  // namespace fogbank::scene::test
