// x = two Chebyshev steps on D⁻¹A x = D⁻¹b from zero: D⁻¹(own · b + others · Σ t D⁻¹b).
// Twin: SmoothFromZero in diffusion/src/cpu/multigrid.rs.

override own: f32;
override others: f32;

@group(1) @binding(0) var<storage, read> inverse_diagonal: array<f32>;
@group(1) @binding(1) var<storage, read> b: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read_write> x: array<vec4<f32>>;

fn value(place: vec3<u32>, i: u32) -> vec4<f32> {
    return inverse_diagonal[cell_at(place)] * b[i];
}

fn visit(place: vec3<u32>, cell: u32, i: u32) -> vec4<f32> {
    x[i] = inverse_diagonal[cell] * (own * b[i] + others * inflow(place, i, vec4(0.0)));
    return vec4(0.0);
}

@compute @workgroup_size(64)
fn smooth_from_zero(@builtin(global_invocation_id) id: vec3<u32>) {
    walk(id);
}
