//! Kernels of `shaders` against their twins on the CPU, on whatever Vulkan device there is (a
//! software one will do). Without one the test says that it was skipped.

use diffusion::{Batch, Medium, Operator};
use material::{Grid, LateralBoundary, Optics};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wgpu::util::{BufferInitDescriptor, DeviceExt};

const SEED: u64 = 20260731;
const LANES: usize = 16;

/// A block as rough as they come: κ and μ log-uniform over three and two decades, cell by cell.
fn block(cells: [usize; 3], lateral: LateralBoundary, rng: &mut ChaCha8Rng) -> Operator {
    let grid = Grid::new(cells, [0.4, 0.5, 0.3]).unwrap();
    let mut field = |lowest: f64, decades: f64| -> Vec<f64> {
        (0..grid.len()).map(|_| lowest * 10f64.powf(decades * rng.random::<f64>())).collect()
    };
    let (kappa, mu) = (field(0.01, 3.0), field(0.001, 2.0));
    let medium = Medium::new(grid, kappa, mu).unwrap();
    Operator::new(&medium, &Optics { lateral, ..Optics::from_eta(1.4) })
}

fn random(cells: usize, rng: &mut ChaCha8Rng) -> Batch {
    let mut out = Batch::zeros(cells, LANES);
    out.block_mut(0).fill_with(|| rng.random_range(-1.0..1.0));
    out
}

/// |v|, value by value.
fn magnitude(v: &Batch) -> Batch {
    let mut out = v.clone();
    out.block_mut(0).iter_mut().for_each(|v| *v = v.abs());
    out
}

/// A device for compute, or None (said aloud) where the machine has none.
fn device() -> Option<(wgpu::Device, wgpu::Queue)> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = match pollster::block_on(instance.request_adapter(&Default::default())) {
        Ok(adapter) => adapter,
        Err(error) => {
            eprintln!("SKIPPED: no graphics device to run kernels on: {error}");
            return None;
        }
    };
    eprintln!("kernels run on {}", adapter.get_info().name);
    Some(pollster::block_on(adapter.request_device(&Default::default())).unwrap())
}

/// Runs `shaders::RESIDUAL` and brings r back.
fn residual_on_gpu(
    (device, queue): &(wgpu::Device, wgpu::Queue),
    operator: &Operator,
    b: &Batch,
    x: &Batch,
) -> Vec<f32> {
    let upload = |values: &[f64]| {
        let bytes: Vec<u8> = values.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect();
        let usage = wgpu::BufferUsages::STORAGE;
        device.create_buffer_init(&BufferInitDescriptor { label: None, contents: &bytes, usage })
    };
    let [nx, ny, nz] = operator.cells().map(|n| n as u32);
    let shape: Vec<u8> = [nx, ny, nz, 0].into_iter().flat_map(u32::to_le_bytes).collect();
    let shape = device.create_buffer_init(&BufferInitDescriptor {
        label: None,
        contents: &shape,
        usage: wgpu::BufferUsages::UNIFORM,
    });
    let buffer = |usage| {
        let size = (4 * LANES * operator.len()) as u64;
        let mapped_at_creation = false;
        device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size,
            usage,
            mapped_at_creation,
        })
    };
    let r = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
    let back = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
    let mut buffers = vec![shape];
    buffers.extend((0..3).map(|axis| upload(operator.links(axis))));
    buffers.extend([upload(operator.diagonal()), upload(b.block(0)), upload(x.block(0)), r]);

    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("residual"),
        source: wgpu::ShaderSource::Wgsl(shaders::RESIDUAL.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("residual"),
        layout: None,
        module: &module,
        entry_point: Some("residual"),
        compilation_options: Default::default(),
        cache: None,
    });
    let entries: Vec<wgpu::BindGroupEntry<'_>> = (0..)
        .zip(&buffers)
        .map(|(binding, b)| wgpu::BindGroupEntry { binding, resource: b.as_entire_binding() })
        .collect();
    let layout = pipeline.get_bind_group_layout(0);
    let bindings = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &layout,
        entries: &entries,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bindings, &[]);
        pass.dispatch_workgroups((nx * LANES as u32).div_ceil(64), ny, nz);
    }
    encoder.copy_buffer_to_buffer(&buffers[7], 0, &back, 0, back.size());
    queue.submit([encoder.finish()]);
    back.map_async(wgpu::MapMode::Read, .., |mapped| mapped.unwrap());
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let bytes = back.get_mapped_range(..).unwrap();
    bytes.as_chunks::<4>().0.iter().map(|v| f32::from_le_bytes(*v)).collect()
}

/// The kernel in single precision against the twin in double.
///
/// With S = |b| + d|x| + Σ t|x_neighbour| every term of the sum is off by at most two roundings of
/// what was uploaded, one of the product and seven of the additions: 10 roundings of 2⁻²⁴, a few
/// parts in 10⁷ of which are of second order. A contracted multiply-add rounds less.
#[test]
fn residual_is_its_twin() {
    let Some(gpu) = device() else { return };
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    // Odd rows, so that workgroups hang over the end; the smallest grid there is; long rows.
    for cells in [[13, 6, 5], [2, 2, 2], [70, 3, 9]] {
        for lateral in [LateralBoundary::Open, LateralBoundary::NoFlux] {
            let operator = block(cells, lateral, &mut rng);
            let (b, x) = (random(operator.len(), &mut rng), random(operator.len(), &mut rng));
            let twin = operator.residual(&b, &x);
            // |b| − A|x| = |b| − d|x| + Σ t|x|: S but for 2d|x|.
            let almost = operator.residual(&magnitude(&b), &magnitude(&x));
            let found = residual_on_gpu(&gpu, &operator, &b, &x);
            assert_eq!(found.len(), LANES * operator.len());
            let mut worst = 0.0f64;
            for (i, r) in found.iter().enumerate() {
                let own = operator.diagonal()[i / LANES] * x.block(0)[i].abs();
                let size = almost.block(0)[i] + 2.0 * own;
                let roundings =
                    (f64::from(*r) - twin.block(0)[i]).abs() / size * f64::from(1 << 24);
                // Written so that a NaN fails too.
                assert!(roundings <= 10.001, "{cells:?} {lateral:?}, value {i}: {roundings}");
                worst = worst.max(roundings);
            }
            eprintln!("{cells:?} {lateral:?}: off by {worst:.2} roundings of 2⁻²⁴");
        }
    }
}
