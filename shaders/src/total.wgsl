// What the workgroups of another kernel left in partials, added up by one workgroup.

@group(1) @binding(0) var<storage, read> partials: array<vec4<f32>>;

const THREADS: u32 = 256u;

var<workgroup> strips: array<vec4<f32>, THREADS>;

// The sum of every `kept`-th vector from `local` on, for the first `kept` invocations. `kept` divides
// THREADS, so that every strip stays with its own.
fn total(local: u32, kept: u32) -> vec4<f32> {
    var sum = vec4(0.0);
    for (var i = local; i < arrayLength(&partials); i += THREADS) {
        sum += partials[i];
    }
    strips[local] = sum;
    for (var half = THREADS / 2u; half >= kept; half /= 2u) {
        workgroupBarrier();
        if local < half {
            strips[local] += strips[local + half];
        }
    }
    workgroupBarrier();
    return strips[local];
}
