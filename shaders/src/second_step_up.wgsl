// x = h + momentum (h − v) + step D⁻¹(b − A h) with h the half-way point and v = x + the coarse
// grid's correction; the dot is x · b.
// Twin: SecondStepUp in diffusion/src/cpu/multigrid.rs.

override momentum: f32;
override step: f32;

@group(1) @binding(0) var<storage, read> inverse_diagonal: array<f32>;
@group(1) @binding(1) var<storage, read> b: array<vec4<f32>>;
@group(1) @binding(2) var<storage, read> half_way: array<vec4<f32>>;
@group(1) @binding(3) var<storage, read> correction: array<vec4<f32>>;
@group(1) @binding(4) var<storage, read_write> x: array<vec4<f32>>;
@group(1) @binding(5) var<storage, read_write> partials: array<vec4<f32>>;

fn value(place: vec3<u32>, i: u32) -> vec4<f32> {
    return half_way[i];
}

fn visit(place: vec3<u32>, cell: u32, i: u32) -> vec4<f32> {
    let parent = place >> level.shift;
    let n = level.coarse;
    let above = ((parent.z * n.y + parent.y) * n.x + parent.x) * level.quads;
    let v = x[i] + correction[above + i % level.quads];
    let h = half_way[i];
    let r = b[i] - absorption[cell] * h + inflow(place, i, h);
    let answer = h + momentum * (h - v) + step * inverse_diagonal[cell] * r;
    x[i] = answer;
    return answer * b[i];
}

@compute @workgroup_size(64)
fn second_step_up(at: Invocation) {
    add_up(at, walk(at.id), level.quads);
}
