// r = b − A x; the dot is r · r.
// Twin: Operator::residual in diffusion/src/operator.rs.

@group(1) @binding(0) var<storage, read> b: array<vec4<f32>>;
@group(1) @binding(1) var<storage, read> x: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read_write> r: array<vec4<f32>>;
@group(1) @binding(3) var<storage, read_write> partials: array<vec4<f32>>;

fn value(place: vec3<u32>, i: u32) -> vec4<f32> {
    return x[i];
}

fn visit(place: vec3<u32>, cell: u32, i: u32) -> vec4<f32> {
    let left = b[i] - absorption[cell] * x[i] + inflow(place, i, x[i]);
    r[i] = left;
    return left * left;
}

@compute @workgroup_size(64)
fn residual(at: Invocation) {
    add_up(at, walk(at.id), level.quads);
}
