#include "render/exr_reader.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include "core/error.h"

namespace fogbank::render {

std::vector<float> decode_rgb(const std::string& file, const scene::Window& window) {
  auto fail = [](const std::string& message) {
    throw Error(ErrorKind::data_loss, "EXR_DECODING", "cannot decode EXR: " + message);
  };
  const auto input = OIIO::ImageInput::create("openexr");
  if (!input) fail(OIIO::geterror());
  OIIO::Filesystem::IOMemReader memory(const_cast<char*>(file.data()), file.size());  // only read
  OIIO::ImageSpec spec;
  if (!input->set_ioproxy(&memory) || !input->open("memory.exr", spec)) fail(input->geterror());
  if (spec.x != window.x || spec.y != window.y || spec.width != window.width ||
      spec.height != window.height) {
    fail("its data window is another one");
  }
  if (spec.nchannels < 3 || spec.channelnames[0] != "R" || spec.channelnames[1] != "G" ||
      spec.channelnames[2] != "B") {
    fail("it has no channels R, G, B");
  }
  std::vector<float> rgb(static_cast<size_t>(window.width) * static_cast<size_t>(window.height) * 3);
  if (!input->read_image(0, 0, 0, 3, OIIO::TypeDesc::FLOAT, rgb.data())) fail(input->geterror());
  return rgb;
}

}  // namespace fogbank::render
