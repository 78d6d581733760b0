//! The optimiser's vectors, kept on the GPU.

use super::Gpu;
use super::device::Pass;
use super::kernels::Kernel;
use super::level::whole;
use crate::inverse::Vector;
use std::rc::Rc;

/// Workgroups of a reduction, each of which leaves one number to be read back.
const GROUPS: u32 = 128;

/// What the vectors of one problem share.
pub(crate) struct VectorSpace {
    gpu: Gpu,
    /// A bind group 0; these kernels do not look at it.
    level: wgpu::BindGroup,
    factor: wgpu::Buffer,
    partials: wgpu::Buffer,
    len: usize,
}

/// `len` numbers of single precision.
pub(crate) struct GpuVector {
    space: Rc<VectorSpace>,
    pub buffer: wgpu::Buffer,
}

impl VectorSpace {
    pub fn new(gpu: &Gpu, level: &wgpu::BindGroup, len: usize) -> Rc<Self> {
        let (factor, partials) = (gpu.buffer(1), gpu.buffer(GROUPS as usize));
        Rc::new(Self { gpu: gpu.clone(), level: level.clone(), factor, partials, len })
    }

    /// A vector of zeros.
    pub fn zeros(self: &Rc<Self>) -> GpuVector {
        GpuVector { space: Rc::clone(self), buffer: self.gpu.buffer(self.len) }
    }

    fn pass(&self, kernel: Kernel, fields: &[&wgpu::Buffer]) -> Pass {
        self.gpu.pass(kernel, &self.level, fields.iter().map(|f| whole(f)), [GROUPS, 1, 1])
    }

    fn submit(&self, pass: &Pass) {
        let mut encoder = self.gpu.encoder();
        self.gpu.record(&mut encoder, [pass]);
        self.gpu.queue.submit([encoder.finish()]);
    }

    /// What the workgroups of a reduction left; not a number when the device is lost, which the
    /// next solve tells.
    fn reduce(&self, kernel: Kernel, x: &GpuVector, y: &GpuVector) -> Vec<f64> {
        let pass = self.pass(kernel, &[&x.buffer, &y.buffer, &self.partials]);
        let mut encoder = self.gpu.encoder();
        self.gpu.record(&mut encoder, [&pass]);
        match self.gpu.submit_and_read(encoder, &self.partials, GROUPS as usize) {
            Ok(parts) => parts.into_iter().map(f64::from).collect(),
            Err(_) => vec![f64::NAN],
        }
    }
}

impl Clone for GpuVector {
    fn clone(&self) -> Self {
        let gpu = &self.space.gpu;
        let copy = self.space.zeros();
        let mut encoder = gpu.encoder();
        encoder.copy_buffer_to_buffer(&self.buffer, 0, &copy.buffer, 0, self.buffer.size());
        gpu.queue.submit([encoder.finish()]);
        copy
    }
}

impl Vector for GpuVector {
    type Kept = Self;

    fn keep(&self) -> Self {
        self.clone()
    }

    fn dot_kept(&self, kept: &Self) -> f64 {
        self.dot(kept)
    }

    fn add_kept(&mut self, factor: f64, kept: &Self) {
        self.add_scaled(factor, kept);
    }

    fn dot(&self, other: &Self) -> f64 {
        self.space.reduce(Kernel::DotProduct, self, other).into_iter().sum()
    }

    fn add_scaled(&mut self, factor: f64, other: &Self) {
        let space = &self.space;
        space.gpu.write(&space.factor, &[factor as f32]);
        let fields = [&space.factor, &other.buffer, &self.buffer];
        space.submit(&space.pass(Kernel::AddScaled, &fields));
    }

    fn scale(&mut self, factor: f64) {
        let space = &self.space;
        space.gpu.write(&space.factor, &[factor as f32]);
        space.submit(&space.pass(Kernel::Scale, &[&space.factor, &self.buffer]));
    }

    fn largest(&self) -> f64 {
        let parts = self.space.reduce(Kernel::Largest, self, self);
        parts.into_iter().fold(0.0, |a, b| if b.is_nan() { b } else { b.max(a) })
    }
}
