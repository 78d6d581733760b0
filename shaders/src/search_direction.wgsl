// out = z + β p; the dot is out · A out.
// Twin: SearchDirection in diffusion/src/cpu/pcg.rs.

@group(1) @binding(0) var<storage, read> scalars: Scalars;
@group(1) @binding(1) var<storage, read> z_field: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read> p: array<vec4<f32>>;
@group(1) @binding(3) var<storage, read_write> out: array<vec4<f32>>;
@group(1) @binding(4) var<storage, read_write> partials: array<vec4<f32>>;

fn value(place: vec3<u32>, i: u32) -> vec4<f32> {
    return z_field[i] + scalars.beta[i % level.quads] * p[i];
}

fn visit(place: vec3<u32>, cell: u32, i: u32) -> vec4<f32> {
    let here = value(place, i);
    out[i] = here;
    return here * (absorption[cell] * here - inflow(place, i, here));
}

@compute @workgroup_size(64)
fn search_direction(at: Invocation) {
    add_up(at, walk(at.id), level.quads);
}
