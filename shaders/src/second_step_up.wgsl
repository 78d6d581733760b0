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

@compute @workgroup_size(64)
fn second_step_up(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let column = vec2(id.x / level.quads, id.y);
    let quad = id.x % level.quads;
    var dot = vec4(0.0);
    if all(column < level.cells.xy) {
        let last = min((id.z + 1u) * level.planes, level.cells.z);
        for (var z = id.z * level.planes; z < last; z++) {
            let place = vec3(column, z);
            let cell = cell_at(place);
            let i = cell * level.quads + quad;
            let parent = place >> level.shift;
            let n = level.coarse;
            let above = ((parent.z * n.y + parent.y) * n.x + parent.x) * level.quads + quad;
            let v = x[i] + correction[above];
            let h = half_way[i];
            let r = b[i] - absorption[cell] * h + inflow(place, i, h);
            let answer = h + momentum * (h - v) + step * inverse_diagonal[cell] * r;
            x[i] = answer;
            dot += answer * b[i];
        }
    }
    add_up(local, group, groups, dot);
}
