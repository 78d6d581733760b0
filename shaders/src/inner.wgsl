// Of the optimiser's vectors: x · y, and the largest |x|. They are left one a workgroup; the rest is
// done in double precision.
// Twin: Vector for Vec<f64> in diffusion/src/inverse/objective.rs.

@group(1) @binding(0) var<storage, read> x: array<f32>;
@group(1) @binding(1) var<storage, read> y: array<f32>;
@group(1) @binding(2) var<storage, read_write> partials: array<f32>;

const THREADS: u32 = 256u;

var<workgroup> strip: array<f32, THREADS>;

@compute @workgroup_size(THREADS)
fn dot_product(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    var sum = 0.0;
    for (var i = id.x; i < arrayLength(&x); i += groups.x * THREADS) {
        sum += x[i] * y[i];
    }
    strip[local] = sum;
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            strip[local] += strip[local + half];
        }
    }
    if local == 0u {
        partials[group.x] = strip[0];
    }
}

@compute @workgroup_size(THREADS)
fn largest(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    var most = 0.0;
    for (var i = id.x; i < arrayLength(&x); i += groups.x * THREADS) {
        most = max(most, abs(x[i]));
    }
    strip[local] = most;
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            strip[local] = max(strip[local], strip[local + half]);
        }
    }
    if local == 0u {
        partials[group.x] = strip[0];
    }
}
