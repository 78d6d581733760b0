// The dot is b · b.
// Twin: norms in diffusion/src/cpu/mod.rs.

@group(1) @binding(0) var<storage, read> b: array<vec4<f32>>;
@group(1) @binding(1) var<storage, read_write> partials: array<vec4<f32>>;

fn visit(place: vec3<u32>, cell: u32, i: u32) -> vec4<f32> {
    return b[i] * b[i];
}

@compute @workgroup_size(64)
fn square(at: Invocation) {
    add_up(at, walk(at.id), level.quads);
}
