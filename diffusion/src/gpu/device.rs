//! The device: which one, and the few calls of it that everything else here is made of.

use super::GpuError;
use super::kernels::{Kernel, Pipelines};
use super::level::{Level, whole};
use std::sync::{Arc, Mutex};
use std::time::Instant;
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// Storage buffers that a kernel sees at most: a level's four and eight of its own.
const STORAGE_BUFFERS: u32 = 12;

/// An open GPU with its compiled kernels. Cheap to clone.
#[derive(Clone)]
pub struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pipelines: Arc<Pipelines>,
    info: wgpu::AdapterInfo,
    lost: Arc<Mutex<Option<String>>>,
}

/// One dispatch of a kernel, with all that it works on.
#[derive(Clone)]
pub(crate) struct Pass {
    kernel: Kernel,
    level: wgpu::BindGroup,
    fields: wgpu::BindGroup,
    groups: [u32; 3],
}

impl Gpu {
    /// Opens the adapter whose name contains `name` (whatever the case), or the fastest kind there
    /// is: discrete, integrated, virtual, and software last.
    ///
    /// # Errors
    /// There is none, or it lacks what the kernels need.
    pub fn open(name: Option<&str>) -> Result<Self, GpuError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
        adapters.sort_by_key(|adapter| match adapter.get_info().device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        });
        let found: Vec<String> = adapters.iter().map(|a| a.get_info().name).collect();
        let fits =
            |have: &str| name.is_none_or(|n| have.to_lowercase().contains(&n.to_lowercase()));
        let adapter = adapters
            .into_iter()
            .find(|adapter| fits(&adapter.get_info().name))
            .ok_or_else(|| GpuError::NoAdapter { wanted: name.map(str::to_owned), found })?;
        Self::from_adapter(&adapter)
    }

    fn from_adapter(adapter: &wgpu::Adapter) -> Result<Self, GpuError> {
        let info = adapter.get_info();
        let limits = adapter.limits();
        let offered = limits.max_storage_buffers_per_shader_stage;
        if offered < STORAGE_BUFFERS {
            return Err(GpuError::Limit {
                adapter: info.name,
                what: "storage buffers a kernel",
                needed: STORAGE_BUFFERS.into(),
                found: offered.into(),
            });
        }
        let fail = |message: String| GpuError::Device { adapter: info.name.clone(), message };
        // All that the adapter has: the size of a binding decides how large a block can be.
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("diaphane"),
            required_limits: limits,
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| fail(error.to_string()))?;
        let lost = Arc::new(Mutex::new(None));
        let told = Arc::clone(&lost);
        device.set_device_lost_callback(move |reason, message| {
            if let Ok(mut told) = told.lock() {
                *told = Some(format!("{reason:?} {message}"));
            }
        });
        // Whatever is asked of a lost device is an error of its own, and by default wgpu panics: the
        // first one is kept, and told when something is next brought back.
        let told = Arc::clone(&lost);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            if let Ok(mut told) = told.lock() {
                told.get_or_insert_with(|| error.to_string());
            }
        }));
        let pipelines = Arc::new(Pipelines::new(&device));
        Ok(Self { device, queue, pipelines, info, lost })
    }

    /// Name of the adapter, as its driver gives it.
    pub fn name(&self) -> &str {
        &self.info.name
    }

    /// Whether it is a program that plays a GPU on the CPU.
    pub fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// The largest buffer that a kernel can see, in bytes.
    pub fn largest_binding(&self) -> u64 {
        let limits = self.device.limits();
        limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
    }

    /// Bytes a second of y += f x, the bound of everything that is done here.
    ///
    /// # Errors
    /// The device was lost, or has not the memory for two arrays.
    pub fn bandwidth(&self) -> Result<f64, GpuError> {
        const PASSES: usize = 50;
        // 256 MB each where a binding may be that large: far beyond any cache.
        let len = (self.largest_binding() / 4).min(1 << 26) as usize;
        let small = Level::new(self, [2; 3], [2; 3], 1);
        let (x, y, factor) = self.allocating(
            || (self.buffer(len), self.buffer(len), self.buffer(1)),
            || GpuError::Device { adapter: self.name().into(), message: "out of memory".into() },
        )?;
        self.write(&factor, &[0.5]);
        let fields = [&factor, &x, &y].map(whole);
        let pass = self.pass(Kernel::AddScaled, &small.group, fields, [8192, 1, 1]);
        let mut best = f64::INFINITY;
        for passes in [1, PASSES / 10, PASSES] {
            let mut encoder = self.encoder();
            self.record(&mut encoder, std::iter::repeat_n(&pass, passes));
            let began = Instant::now();
            self.submit_and_read(encoder, &factor, 1)?;
            best = best.min(began.elapsed().as_secs_f64() / passes as f64);
        }
        Ok(3.0 * 4.0 * len as f64 / best)
    }

    /// An uninitialised buffer of `len` values of four bytes.
    pub(crate) fn buffer(&self, len: usize) -> wgpu::Buffer {
        use wgpu::BufferUsages as Usage;
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 4 * len.max(4) as u64,
            usage: Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// Runs `allocate`, and answers `too_large` if there was not the memory for it.
    pub(crate) fn allocating<T>(
        &self,
        allocate: impl FnOnce() -> T,
        too_large: impl FnOnce() -> GpuError,
    ) -> Result<T, GpuError> {
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let made = allocate();
        match pollster::block_on(scope.pop()) {
            None => Ok(made),
            Some(_) => Err(too_large()),
        }
    }

    pub(crate) fn uniform(&self, words: &[u32]) -> wgpu::Buffer {
        self.device.create_buffer_init(&BufferInitDescriptor {
            label: None,
            contents: bytemuck::cast_slice(words),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        })
    }

    pub(crate) fn write(&self, buffer: &wgpu::Buffer, values: &[f32]) {
        self.queue.write_buffer(buffer, 0, bytemuck::cast_slice(values));
    }

    /// The bind group 0 of a level.
    pub(crate) fn level_group(
        &self,
        uniform: &wgpu::Buffer,
        coefficients: [&wgpu::Buffer; 4],
    ) -> wgpu::BindGroup {
        let all = [uniform].into_iter().chain(coefficients);
        let entries: Vec<_> = (0..)
            .zip(all)
            .map(|(binding, b)| wgpu::BindGroupEntry { binding, resource: b.as_entire_binding() })
            .collect();
        let layout = self.pipelines.level_layout();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout,
            entries: &entries,
        })
    }

    /// A dispatch of `groups` workgroups of a kernel on a level and fields.
    pub(crate) fn pass<'a>(
        &self,
        kernel: Kernel,
        level: &wgpu::BindGroup,
        fields: impl IntoIterator<Item = wgpu::BufferBinding<'a>>,
        groups: [u32; 3],
    ) -> Pass {
        let entries: Vec<_> = (0..)
            .zip(fields)
            .map(|(binding, field)| {
                let resource = wgpu::BindingResource::Buffer(field);
                wgpu::BindGroupEntry { binding, resource }
            })
            .collect();
        let fields = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: self.pipelines.fields_layout(kernel),
            entries: &entries,
        });
        Pass { kernel, level: level.clone(), fields, groups }
    }

    /// Gives the device up: whatever it is asked from here on ends in [`GpuError::Lost`], as after a reset.
    #[doc(hidden)]
    pub fn give_up(&self) {
        self.device.destroy();
    }

    /// Records dispatches, one after the other, each of which sees what those before it wrote.
    pub(crate) fn record<'a>(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        passes: impl IntoIterator<Item = &'a Pass>,
    ) {
        let mut recording = encoder.begin_compute_pass(&Default::default());
        for pass in passes {
            recording.set_pipeline(self.pipelines.get(pass.kernel));
            recording.set_bind_group(0, &pass.level, &[]);
            recording.set_bind_group(1, &pass.fields, &[]);
            let [x, y, z] = pass.groups;
            recording.dispatch_workgroups(x, y, z);
        }
    }

    pub(crate) fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&Default::default())
    }

    /// Submits what was recorded and brings the first `len` values of a buffer back.
    ///
    /// # Errors
    /// The device was lost.
    pub(crate) fn submit_and_read(
        &self,
        mut encoder: wgpu::CommandEncoder,
        buffer: &wgpu::Buffer,
        len: usize,
    ) -> Result<Vec<f32>, GpuError> {
        let size = 4 * len as u64;
        let back = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        encoder.copy_buffer_to_buffer(buffer, 0, &back, 0, size);
        self.queue.submit([encoder.finish()]);
        let result = Arc::new(Mutex::new(None));
        let slot = Arc::clone(&result);
        back.map_async(wgpu::MapMode::Read, .., move |mapped| {
            if let Ok(mut slot) = slot.lock() {
                *slot = Some(mapped);
            }
        });
        let polled = self.device.poll(wgpu::PollType::wait_indefinitely());
        let mapped = result.lock().ok().and_then(|mut slot| slot.take());
        let sound = self.lost.lock().is_ok_and(|told| told.is_none());
        match (polled, mapped) {
            (Ok(_), Some(Ok(()))) if sound => {
                let view = back.get_mapped_range(..).map_err(|e| self.lost(e.to_string()))?;
                Ok(bytemuck::cast_slice(&view).to_vec())
            }
            (polled, mapped) => Err(self.lost(format!("{polled:?} {mapped:?}"))),
        }
    }

    fn lost(&self, message: String) -> GpuError {
        let told = self.lost.lock().ok().and_then(|told| told.clone());
        GpuError::Lost { adapter: self.info.name.clone(), message: told.unwrap_or(message) }
    }
}
