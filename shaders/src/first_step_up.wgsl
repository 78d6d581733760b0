// out = v + D⁻¹(b − A v)/θ with v = x + the coarse grid's correction.
// Twin: FirstStepUp in diffusion/src/cpu/multigrid.rs.

override first: f32;

@group(1) @binding(0) var<storage, read> inverse_diagonal: array<f32>;
@group(1) @binding(1) var<storage, read> b: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read> x: array<vec4<f32>>;
@group(1) @binding(3) var<storage, read> correction: array<vec4<f32>>;
@group(1) @binding(4) var<storage, read_write> out: array<vec4<f32>>;

fn value(place: vec3<u32>, i: u32) -> vec4<f32> {
    let parent = place >> level.shift;
    let n = level.coarse;
    let above = ((parent.z * n.y + parent.y) * n.x + parent.x) * level.quads;
    return x[i] + correction[above + i % level.quads];
}

fn visit(place: vec3<u32>, cell: u32, i: u32) -> vec4<f32> {
    let v = value(place, i);
    let r = b[i] - absorption[cell] * v + inflow(place, i, v);
    out[i] = v + first * inverse_diagonal[cell] * r;
    return vec4(0.0);
}

@compute @workgroup_size(64)
fn first_step_up(@builtin(global_invocation_id) id: vec3<u32>) {
    walk(id);
}
