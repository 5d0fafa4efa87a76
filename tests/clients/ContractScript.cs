// The calls of test_contract_of_languages.py in C#: the gateway's address is its argument.
using System;
using System.Globalization;
using System.Linq;
using System.Threading;
using System.Threading.Tasks;
using Hapticd;

static class ContractScript
{
    static int Main(string[] words)
    {
        CultureInfo.DefaultThreadCurrentCulture = new CultureInfo("de-DE"); // whose numbers have a comma
        return Run(words[0]).GetAwaiter().GetResult();
    }

    static async Task<int> Run(string address)
    {
        var plate = await Plate.ConnectAsync(address, "csharp", timeoutS: 30);
        await plate.SetAsync(1, new Fields { { "friction", 0.2 } });
        await plate.SetAsync(2, new Fields { { "grating", new Fields {
            { "period_mm", 4 }, { "high_um", 2 }, { "low_um", 0.5 }, { "angle_rad", 0.25 }, { "duty_frac", 0.5 } } } });
        await plate.SurfaceAsync("patch", new Fields { { "amplitude_um", 1.25 }, { "rectangle_mm", new[] { 40.0, 20.0 } },
            { "position_mm", new[] { 10.0, -5.0 } }, { "angle_rad", 0.5 }, { "z", 3 } });
        await plate.SurfaceAsync("disc", new Fields { { "friction", 0.1 }, { "circle_mm", 8 } });
        if (await plate.MarkerAsync("trial 1") <= 0) return 1;
        try { await plate.SetAsync(1, new Fields { { "friction", 1.5 } }); }
        catch (RefusedException refused) { Console.WriteLine("refused: " + refused.Message); }
        var read = 0;
        var came = new TaskCompletionSource<State>();
        plate.StateCame += state => { if (Interlocked.Increment(ref read) == 100) came.TrySetResult(state); };
        await plate.FollowAsync();
        var fingers = (await came.Task).Fingers.Select(one => string.Format(CultureInfo.InvariantCulture, "{0} {1} {2} {3}",
            one.Id, one.XMm, one.YMm, one.TargetUm == null ? 0 : 1));
        Console.WriteLine("fingers: " + string.Join(" ", fingers));
        await plate.ReleaseAsync(1);
        await plate.RemoveAsync("patch");
        await plate.CloseAsync();
        return 0;
    }
}
