// The right-hand side: what the beam scatters in every cell, and what comes in through the lit face.
// Twin: Forward::right_hand_side in diffusion/src/forward.rs.

@group(1) @binding(1) var<storage, read> source: array<f32>;
@group(1) @binding(2) var<storage, read> irradiance: array<vec4<f32>>; // of the lit face's cells
@group(1) @binding(3) var<storage, read_write> b: array<vec4<f32>>;

@compute @workgroup_size(64)
fn illuminate(@builtin(global_invocation_id) id: vec3<u32>) {
    let column = vec2(id.x / level.quads, id.y);
    if any(column >= level.cells.xy) {
        return;
    }
    let quad = id.x % level.quads;
    let plane = level.cells.x * level.cells.y;
    let column_number = column.y * level.cells.x + column.x;
    let light = irradiance[column_number * level.quads + quad];
    let lit = lit_depth(0u);
    let face = select(level.cells.z, 0u, block.lit_front == 1u) * plane + column_number;
    let last = min((id.z + 1u) * level.planes, level.cells.z);
    for (var z = id.z * level.planes; z < last; z++) {
        let cell = cell_at(vec3(column, z));
        var enters = block.beam * source[cell];
        if z == lit {
            enters += block.drive * face_z[face];
        }
        b[cell * level.quads + quad] = enters * light;
    }
}
