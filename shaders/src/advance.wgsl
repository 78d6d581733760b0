// x += α p, r −= α A p, with A p worked out once more instead of having been stored; the dot is
// r · r.
// Twins: AdvanceSolution and AdvanceResidual in diffusion/src/cpu/pcg.rs.

@group(1) @binding(0) var<storage, read> scalars: Scalars;
@group(1) @binding(1) var<storage, read> p: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read_write> x: array<vec4<f32>>;
@group(1) @binding(3) var<storage, read_write> r: array<vec4<f32>>;
@group(1) @binding(4) var<storage, read_write> partials: array<vec4<f32>>;

fn value(place: vec3<u32>, i: u32) -> vec4<f32> {
    return p[i];
}

fn visit(place: vec3<u32>, cell: u32, i: u32) -> vec4<f32> {
    let alpha = scalars.alpha[i % level.quads];
    x[i] += alpha * p[i];
    let left = r[i] - alpha * (absorption[cell] * p[i] - inflow(place, i, p[i]));
    r[i] = left;
    return left * left;
}

@compute @workgroup_size(64)
fn advance(at: Invocation) {
    add_up(at, walk(at.id), level.quads);
}
