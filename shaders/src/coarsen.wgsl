// The next level's conductances and absorption, as resistances in series and in parallel.
// Twin: coarsen in diffusion/src/cpu/level.rs, which takes one axis after the other.

@group(1) @binding(0) var<storage, read_write> coarse_x: array<f32>;
@group(1) @binding(1) var<storage, read_write> coarse_y: array<f32>;
@group(1) @binding(2) var<storage, read_write> coarse_z: array<f32>;
@group(1) @binding(3) var<storage, read_write> coarse_absorption: array<f32>;

// Across coarse face `at` of an axis whose cells come in pairs: `between` is the conductance of the
// fine face that lies there, `before` and `after` those in the middle of the pairs on either side;
// 0 where there is no pair.
fn in_series(before: f32, between: f32, after: f32) -> f32 {
    if between == 0.0 {
        return 0.0;
    }
    var resistance = 1.0 / between;
    if before > 0.0 {
        resistance += 0.5 / before;
    }
    if after > 0.0 {
        resistance += 0.5 / after;
    }
    return 1.0 / resistance;
}

// The fine faces that belong to coarse face `at` of an axis of n cells: the one before it, its own,
// the one after it; n + 1 where there is none.
fn fine_faces(at: u32, n: u32, shift: u32) -> vec3<u32> {
    if shift == 0u {
        return vec3(n + 1u, at, n + 1u);
    }
    let own = min(2u * at, n);
    let before = select(n + 1u, 2u * at - 1u, at > 0u && 2u * at - 1u < n);
    let after = select(n + 1u, own + 1u, own + 1u < n);
    return vec3(before, own, after);
}

@compute @workgroup_size(64)
fn coarsen_x(@builtin(global_invocation_id) id: vec3<u32>) {
    let n = level.cells;
    let m = level.coarse;
    if id.x > m.x || id.y >= m.y || id.z >= m.z {
        return;
    }
    let at = fine_faces(id.x, n.x, level.shift.x);
    let first = id.yz << level.shift.yz;
    let end = min((id.yz + 1u) << level.shift.yz, n.yz);
    var sum = 0.0;
    for (var z = first.y; z < end.y; z++) {
        for (var y = first.x; y < end.x; y++) {
            let row = (z * n.y + y) * (n.x + 1u);
            var t = vec3(0.0);
            for (var k = 0u; k < 3u; k++) {
                if at[k] <= n.x {
                    t[k] = face_x[row + at[k]];
                }
            }
            sum += in_series(t.x, t.y, t.z);
        }
    }
    coarse_x[(id.z * m.y + id.y) * (m.x + 1u) + id.x] = sum;
}

@compute @workgroup_size(64)
fn coarsen_y(@builtin(global_invocation_id) id: vec3<u32>) {
    let n = level.cells;
    let m = level.coarse;
    if id.x >= m.x || id.y > m.y || id.z >= m.z {
        return;
    }
    let at = fine_faces(id.y, n.y, level.shift.y);
    let first = id.xz << level.shift.xz;
    let end = min((id.xz + 1u) << level.shift.xz, n.xz);
    var sum = 0.0;
    for (var z = first.y; z < end.y; z++) {
        var t = vec3(0.0);
        for (var x = first.x; x < end.x; x++) {
            for (var k = 0u; k < 3u; k++) {
                if at[k] <= n.y {
                    t[k] += face_y[(z * (n.y + 1u) + at[k]) * n.x + x];
                }
            }
        }
        sum += in_series(t.x, t.y, t.z);
    }
    coarse_y[(id.z * (m.y + 1u) + id.y) * m.x + id.x] = sum;
}

@compute @workgroup_size(64)
fn coarsen_z(@builtin(global_invocation_id) id: vec3<u32>) {
    let n = level.cells;
    let m = level.coarse;
    if id.x >= m.x || id.y >= m.y || id.z > m.z {
        return;
    }
    let at = fine_faces(id.z, n.z, level.shift.z);
    let first = id.xy << level.shift.xy;
    let end = min((id.xy + 1u) << level.shift.xy, n.xy);
    var t = vec3(0.0);
    for (var y = first.y; y < end.y; y++) {
        for (var x = first.x; x < end.x; x++) {
            for (var k = 0u; k < 3u; k++) {
                if at[k] <= n.z {
                    t[k] += face_z[(at[k] * n.y + y) * n.x + x];
                }
            }
        }
    }
    coarse_z[(id.z * m.y + id.y) * m.x + id.x] = in_series(t.x, t.y, t.z);
}

@compute @workgroup_size(64)
fn coarsen_cells(@builtin(global_invocation_id) id: vec3<u32>) {
    let m = level.coarse;
    if any(id >= m) {
        return;
    }
    let first = id << level.shift;
    let end = min((id + 1u) << level.shift, level.cells);
    var sum = 0.0;
    for (var z = first.z; z < end.z; z++) {
        for (var y = first.y; y < end.y; y++) {
            for (var x = first.x; x < end.x; x++) {
                sum += absorption[cell_at(vec3(x, y, z))];
            }
        }
    }
    coarse_absorption[(id.z * m.y + id.y) * m.x + id.x] = sum;
}
