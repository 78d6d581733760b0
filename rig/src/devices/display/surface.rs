//! The picture on its way to the screen, byte for byte.

use std::sync::Arc;
use std::time::{Duration, Instant};

use wgpu::{CurrentSurfaceTexture as Current, TextureFormat, TextureUsages};
use winit::event_loop::OwnedDisplayHandle;
use winit::window::Window;

use crate::ProjectorImage;

/// A picture should be drawn in milliseconds, and in a second where the processor draws it.
const PATIENCE: Duration = Duration::from_secs(5);

/// What is shown in a window.
pub(super) struct Picture {
    surface: wgpu::Surface<'static>,
    device: wgpu::Device,
    queue: wgpu::Queue,
    configuration: wgpu::SurfaceConfiguration,
    /// Four bytes a pixel, as the screen takes them.
    bytes: Vec<u8>,
}

impl Picture {
    /// A black picture of `[width, height]` pixels, not shown yet. An error says what is missing.
    pub(super) fn new(
        window: Arc<Window>,
        display: OwnedDisplayHandle,
        [width, height]: [u32; 2],
    ) -> Result<Self, String> {
        let descriptor = wgpu::InstanceDescriptor::new_with_display_handle(Box::new(display));
        let instance = wgpu::Instance::new(descriptor);
        let surface = instance.create_surface(window).map_err(|error| error.to_string())?;
        let options = wgpu::RequestAdapterOptions {
            compatible_surface: Some(&surface),
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options))
            .map_err(|error| format!("no Vulkan driver can draw on this screen: {error}"))?;
        let limits = wgpu::Limits::downlevel_defaults().using_resolution(adapter.limits());
        let descriptor = wgpu::DeviceDescriptor { required_limits: limits, ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| error.to_string())?;
        let can = surface.get_capabilities(&adapter);
        // Formats with "Srgb" convert what is written; these do not.
        let plain = [TextureFormat::Bgra8Unorm, TextureFormat::Rgba8Unorm];
        let format = plain.into_iter().find(|format| can.formats.contains(format));
        let format = format.ok_or("the screen takes no plain 8-bit colours")?;
        if !can.usages.contains(TextureUsages::COPY_DST) {
            return Err("the screen takes no pictures, only drawings".into());
        }
        let configuration = wgpu::SurfaceConfiguration {
            // Bytes are copied: nothing is drawn, interpolated or blended.
            usage: TextureUsages::COPY_DST | TextureUsages::RENDER_ATTACHMENT,
            format,
            color_space: wgpu::SurfaceColorSpace::Auto,
            width,
            height,
            present_mode: wgpu::PresentMode::Fifo,
            desired_maximum_frame_latency: 1,
            alpha_mode: wgpu::CompositeAlphaMode::Auto,
            view_formats: Vec::new(),
        };
        surface.configure(&device, &configuration);
        let bytes = [0, 0, 0, 255].repeat(width as usize * height as usize);
        Ok(Self { surface, device, queue, configuration, bytes })
    }

    /// Takes another picture, of the same size, to show.
    pub(super) fn set(&mut self, image: &ProjectorImage) -> Result<(), String> {
        let (width, height) = (self.configuration.width, self.configuration.height);
        if (image.width, image.height) != (width, height)
            || 4 * image.data.len() != self.bytes.len()
        {
            let found = format!("{} x {}", image.width, image.height);
            return Err(format!("an image of {found} on {width} x {height} pixels"));
        }
        for (pixel, &level) in self.bytes.chunks_exact_mut(4).zip(&image.data) {
            pixel.copy_from_slice(&[level, level, level, 255]);
        }
        Ok(())
    }

    /// Presents the picture and returns when the graphics device has finished with it.
    pub(super) fn present(&self) -> Result<(), String> {
        let started = Instant::now();
        let texture = loop {
            match self.surface.get_current_texture() {
                Current::Success(texture) | Current::Suboptimal(texture) => break texture,
                // The screen was set up anew, or has no room for a moment.
                Current::Outdated | Current::Lost if started.elapsed() < PATIENCE => {
                    self.surface.configure(&self.device, &self.configuration);
                }
                Current::Timeout | Current::Occluded if started.elapsed() < PATIENCE => {
                    std::thread::sleep(Duration::from_millis(5));
                }
                other => return Err(format!("the screen takes no picture: {other:?}")),
            }
        };
        let (width, height) = (self.configuration.width, self.configuration.height);
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(4 * width),
            rows_per_image: None,
        };
        self.queue.write_texture(texture.texture.as_image_copy(), &self.bytes, layout, size);
        let submitted = self.queue.submit([]);
        self.queue.present(texture);
        let wait =
            wgpu::PollType::Wait { submission_index: Some(submitted), timeout: Some(PATIENCE) };
        self.device.poll(wait).map(drop).map_err(|error| error.to_string())
    }
}
