// y *= factor, for the optimiser's vectors.
// Twin: Vector for Vec<f64> in diffusion/src/inverse/objective.rs.

@group(1) @binding(0) var<storage, read> factor: array<f32>;
@group(1) @binding(1) var<storage, read_write> y: array<f32>;

@compute @workgroup_size(256)
fn scale(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    for (var i = id.x; i < arrayLength(&y); i += groups.x * 256u) {
        y[i] *= factor[0];
    }
}
