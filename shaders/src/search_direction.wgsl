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

@compute @workgroup_size(64)
fn search_direction(
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let column = vec2(id.x / level.quads, id.y);
    var dot = vec4(0.0);
    if all(column < level.cells.xy) {
        let last = min((id.z + 1u) * level.planes, level.cells.z);
        for (var z = id.z * level.planes; z < last; z++) {
            let place = vec3(column, z);
            let cell = cell_at(place);
            let i = cell * level.quads + id.x % level.quads;
            let here = value(place, i);
            out[i] = here;
            dot += here * (absorption[cell] * here - inflow(place, i, here));
        }
    }
    add_up(local, group, groups, dot);
}
