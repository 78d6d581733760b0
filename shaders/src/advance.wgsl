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

@compute @workgroup_size(64)
fn advance(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let column = vec2(id.x / level.quads, id.y);
    let quad = id.x % level.quads;
    var dot = vec4(0.0);
    if all(column < level.cells.xy) {
        let alpha = scalars.alpha[quad];
        let last = min((id.z + 1u) * level.planes, level.cells.z);
        for (var z = id.z * level.planes; z < last; z++) {
            let place = vec3(column, z);
            let cell = cell_at(place);
            let i = cell * level.quads + quad;
            x[i] += alpha * p[i];
            let left = r[i] - alpha * (absorption[cell] * p[i] - inflow(place, i, p[i]));
            r[i] = left;
            dot += left * left;
        }
    }
    add_up(local, group, groups, dot);
}
