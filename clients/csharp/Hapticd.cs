// Client of hapticd for Unity and .NET, over the WebSocket of `hapticd gateway`: one file, C# 7, no packages.
//
//     using (var plate = await Plate.ConnectAsync("ws://127.0.0.1:8018/client?key=...")) {
//         await plate.SurfaceAsync("track", new Fields { { "rectangle_mm", new[] { 100.0, 24.0 } }, { "friction", 0.05 } });
//         await plate.FollowAsync();
//         foreach (var finger in plate.Newest.Fingers) await plate.SetAsync(finger.Id, new Fields { { "friction", 0.2 } });
//     }
//
// Targets hold while the program runs: they are repeated, and end by their time to live when it dies. Fields and bounds
// are those of clients/PROTOCOL.md. Positions are millimetres, amplitudes micrometres.

using System;
using System.Collections;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Linq;
using System.Net.WebSockets;
using System.Text;
using System.Threading;
using System.Threading.Tasks;

namespace Hapticd
{
    /// <summary>Fields of a message, by their names.</summary>
    public sealed class Fields : Dictionary<string, object> { }

    /// <summary>The daemon, or the gateway, refused a message: the text is its sentence.</summary>
    public sealed class RefusedException : Exception { public RefusedException(string sentence) : base(sentence) { } }

    /// <summary>No daemon answers, or the connection is closed.</summary>
    public sealed class GoneException : Exception { public GoneException(string sentence) : base(sentence) { } }

    /// <summary>A finger in a state. What is not known is null; a virtual finger has a name in place of its number.</summary>
    public sealed class Finger
    {
        public readonly Fields All;
        public Finger(Fields all) { All = all; }
        public bool IsVirtual => !(All["id"] is long);
        public long Id => (long)All["id"];
        public string Name => All["id"] as string;
        public double XMm => Number("x_mm") ?? double.NaN;
        public double YMm => Number("y_mm") ?? double.NaN;
        public double? TargetUm => Number("target_um");
        public double? FeltFriction => Number("felt_friction");
        public double? PressureFrac => Number("pressure_frac");
        /// <summary>Any number of the protocol's.</summary>
        public double? Number(string name) => All.TryGetValue(name, out var value) ? Json.Number(value) : null;
    }

    /// <summary>One instant of the plate.</summary>
    public sealed class State
    {
        public readonly Fields All;
        public readonly IReadOnlyList<Finger> Fingers;
        public State(Fields all)
        {
            All = all;
            Fingers = ((List<object>)all["fingers"]).Select(one => new Finger((Fields)one)).ToList();
        }
        public string Name => (string)All["state"];
        public long TNs => (long)All["t_ns"];
    }

    /// <summary>One client of the daemon. Its calls may come from any thread; they take effect in their order.</summary>
    public sealed class Plate : IDisposable
    {
        const int ProtocolVersion = 1, RefreshesPerTtl = 3, MostBytes = 1 << 22;
        const long MostId = uint.MaxValue;
        static readonly string[] Kinds = { "targets", "virtuals", "surfaces", "effects" };
        static readonly DateTime Epoch = new DateTime(1970, 1, 1, 0, 0, 0, DateTimeKind.Utc);

        readonly ClientWebSocket socket = new ClientWebSocket();
        readonly CancellationTokenSource ending = new CancellationTokenSource();
        readonly SemaphoreSlim changes = new SemaphoreSlim(1), writing = new SemaphoreSlim(1);
        readonly Dictionary<long, TaskCompletionSource<object>> waiting = new Dictionary<long, TaskCompletionSource<object>>();
        readonly Dictionary<string, Dictionary<object, Fields>> held = Kinds.ToDictionary(kind => kind, _ => new Dictionary<object, Fields>());
        readonly HashSet<object> seen = new HashSet<object>(); // fingers with a target that were in a state
        readonly object gate = new object(); // of what is held, what waits, and the counters
        readonly double ttlS;
        readonly TimeSpan timeout;
        long lastId, lastStamp, stamp;
        Timer refresh;
        Task reading;
        volatile State newest;

        public readonly string Name;
        /// <summary>The newest state, null until one came after FollowAsync. Read it in each frame of a game.</summary>
        public State Newest => newest;
        /// <summary>Each state, on a thread of the pool.</summary>
        public event Action<State> StateCame;
        /// <summary>A sentence of the daemon on a repeated message, on a thread of the pool.</summary>
        public event Action<string> Refused;

        Plate(string name, double ttlS, double timeoutS)
        {
            Name = name ?? "csharp-" + Guid.NewGuid().ToString("N").Substring(0, 8);
            this.ttlS = ttlS;
            timeout = TimeSpan.FromSeconds(timeoutS);
        }

        /// <summary>Connect to a gateway and greet its daemon.</summary>
        /// <exception cref="GoneException">No gateway admits this address, or no daemon answers.</exception>
        public static async Task<Plate> ConnectAsync(string address, string name = null, double ttlS = 0.5, double timeoutS = 2)
        {
            var plate = new Plate(name, ttlS, timeoutS);
            try
            {
                await plate.socket.ConnectAsync(new Uri(address), plate.ending.Token).ConfigureAwait(false);
                plate.reading = Task.Run(plate.ReadAsync);
                await plate.RequestAsync("hello").ConfigureAwait(false);
                return plate;
            }
            catch (Exception error) when (!(error is RefusedException || error is GoneException))
            {
                plate.Dispose();
                throw new GoneException("No gateway admits this address (" + error.Message + "): run `hapticd gateway`.");
            }
        }

        // --- targets ---

        /// <summary>Set the target of a finger (its id, or a virtual one's name): `content` has one field, such as `friction`.</summary>
        public Task SetAsync(object finger, Fields content) => ChangeAsync("targets", Key(finger), With("finger", Key(finger), content));

        /// <summary>Define a virtual finger: `path` has at least `path_mm`.</summary>
        public Task VirtualAsync(string name, Fields path) => ChangeAsync("virtuals", name, With("name", name, path));

        /// <summary>Lay content on the plate, in a shape: every finger without a target feels it.</summary>
        public Task SurfaceAsync(string name, Fields fields) => ChangeAsync("surfaces", name, With("name", name, fields));

        /// <summary>Play a form in time. Without a `start` it plays now.</summary>
        public Task EffectAsync(string name, Fields fields)
        {
            var effect = With("name", name, fields);
            if (!effect.ContainsKey("start")) effect["start"] = new Fields { { "cause", "now" }, { "id", NextStamp() } };
            return ChangeAsync("effects", name, effect);
        }

        /// <summary>Release one finger with its effects, or with null everything.</summary>
        public Task ReleaseAsync(object finger = null) => InOrderAsync(async () =>
        {
            var body = new Fields { { "client", Name } };
            lock (gate)
            {
                if (finger == null) foreach (var kind in held.Values) kind.Clear();
                else
                {
                    held["targets"].Remove(Key(finger));
                    held["virtuals"].Remove(Key(finger));
                    Drop("effects", effect => effect.TryGetValue("finger", out var on) && Key(on).Equals(Key(finger)));
                }
                body["stamp"] = stamp = NextStamp();
            }
            if (finger != null) body["finger"] = Key(finger);
            await RequestAsync("release", body).ConfigureAwait(false);
        });

        /// <summary>Remove a surface, and the effects that name it.</summary>
        public Task RemoveAsync(string surface) => InOrderAsync(() =>
        {
            lock (gate)
            {
                held["surfaces"].Remove(surface);
                Drop("effects", effect => Names(effect, surface) || effect.TryGetValue("start", out var start) && start is Fields cause && Names(cause, surface));
            }
            return SendAsync();
        });

        /// <summary>End an effect.</summary>
        public Task StopAsync(string effect) => InOrderAsync(() =>
        {
            lock (gate) held["effects"].Remove(effect);
            return SendAsync();
        });

        // --- requests and states ---

        /// <summary>Add a marker to recordings and to the next state; returns its instant, ns of the daemon's clock.</summary>
        public async Task<long> MarkerAsync(string text)
        {
            var reply = await RequestAsync("marker", new Fields { { "client", Name }, { "text", text } }).ConfigureAwait(false);
            return (long)((Fields)reply)["t_ns"];
        }

        /// <summary>Have states sent from now on: the newest, or all of them, as events need it.</summary>
        public Task FollowAsync(bool isEvery = false) => WriteAsync(new Fields { { "states", isEvery ? "every" : "newest" } });

        /// <summary>Return the body of the reply to any request of the protocol.</summary>
        public async Task<object> RequestAsync(string op, Fields body = null)
        {
            var answer = new TaskCompletionSource<object>(TaskCreationOptions.RunContinuationsAsynchronously);
            long id;
            lock (gate)
            {
                id = lastId = lastId % MostId + 1;
                waiting[id] = answer;
            }
            try
            {
                var message = new Fields { { "id", id }, { "op", op } };
                if (body != null) message["body"] = body;
                await WriteAsync(message).ConfigureAwait(false);
                if (await Task.WhenAny(answer.Task, Task.Delay(timeout, ending.Token)).ConfigureAwait(false) != answer.Task)
                    throw new GoneException("No hapticd answers: start one.");
                return await answer.Task.ConfigureAwait(false);
            }
            finally
            {
                lock (gate) waiting.Remove(id);
            }
        }

        /// <summary>Release everything and disconnect.</summary>
        public async Task CloseAsync()
        {
            try { await ReleaseAsync().ConfigureAwait(false); }
            catch (GoneException) { }
            finally
            {
                Dispose();
                if (reading != null) await reading.ConfigureAwait(false);
            }
        }

        /// <summary>Disconnect: what is held ends by its time to live. CloseAsync releases it at once.</summary>
        public void Dispose()
        {
            lock (gate) refresh?.Dispose();
            ending.Cancel();
            socket.Dispose();
        }

        // --- inside ---

        static object Key(object finger) => finger is string ? finger : Convert.ToInt64(finger, CultureInfo.InvariantCulture);

        static bool Names(Fields fields, string surface) => fields.TryGetValue("surface", out var name) && surface.Equals(name);

        static Fields With(string field, object value, Fields others)
        {
            var all = new Fields { { field, value } };
            foreach (var other in others) all[other.Key] = other.Value;
            return all;
        }

        void Drop(string kind, Func<Fields, bool> isOne)
        {
            foreach (var key in held[kind].Where(one => isOne(one.Value)).Select(one => one.Key).ToList()) held[kind].Remove(key);
        }

        /// <summary>Change one thing. What is refused is taken back, and what was before is sent once more.</summary>
        Task ChangeAsync(string kind, object key, Fields fields) => InOrderAsync(async () =>
        {
            Fields before;
            lock (gate)
            {
                held[kind].TryGetValue(key, out before);
                held[kind][key] = fields;
            }
            try { await SendAsync().ConfigureAwait(false); }
            catch (Exception error)
            {
                lock (gate)
                {
                    if (before == null) held[kind].Remove(key);
                    else held[kind][key] = before;
                }
                if (error is RefusedException) await SendAsync().ConfigureAwait(false);
                throw;
            }
        });

        async Task InOrderAsync(Func<Task> step)
        {
            await changes.WaitAsync(ending.Token).ConfigureAwait(false);
            try { await step().ConfigureAwait(false); }
            finally { changes.Release(); }
        }

        Task SendAsync()
        {
            Fields message;
            lock (gate)
            {
                stamp = NextStamp();
                message = Message();
                if (refresh == null)
                {
                    var every = TimeSpan.FromSeconds(ttlS / RefreshesPerTtl);
                    refresh = new Timer(_ => Repeat(), null, every, every);
                }
            }
            return RequestAsync("set", message);
        }

        Fields Message()
        {
            var message = new Fields { { "client", Name }, { "ttl_s", ttlS }, { "stamp", stamp } };
            foreach (var kind in Kinds.Where(kind => held[kind].Count > 0)) message[kind] = held[kind].Values.ToList();
            return message;
        }

        async void Repeat()
        {
            try
            {
                Fields message;
                lock (gate) message = held.Values.Any(kind => kind.Count > 0) ? Message() : null;
                if (message != null) await WriteAsync(message).ConfigureAwait(false);
            }
            catch (Exception) { } // the connection is gone, which the next call says
        }

        /// <summary>Microseconds since 1970, and always more than before.</summary>
        long NextStamp()
        {
            lock (gate) return lastStamp = Math.Max(lastStamp + 1, (DateTime.UtcNow - Epoch).Ticks / 10);
        }

        async Task WriteAsync(Fields message)
        {
            var bytes = Encoding.UTF8.GetBytes(Json.Write(With("v", ProtocolVersion, message)));
            try
            {
                await writing.WaitAsync(ending.Token).ConfigureAwait(false);
                try { await socket.SendAsync(new ArraySegment<byte>(bytes), WebSocketMessageType.Text, true, ending.Token).ConfigureAwait(false); }
                finally { writing.Release(); }
            }
            catch (Exception error) { throw new GoneException("The connection to the gateway is closed (" + error.Message + ")."); }
        }

        async Task ReadAsync()
        {
            var piece = new ArraySegment<byte>(new byte[1 << 16]);
            var why = "The connection to the gateway is closed.";
            try
            {
                while (true)
                {
                    var whole = new MemoryStream();
                    WebSocketReceiveResult part;
                    do
                    {
                        part = await socket.ReceiveAsync(piece, ending.Token).ConfigureAwait(false);
                        whole.Write(piece.Array, 0, part.Count);
                        if (whole.Length > MostBytes) throw new InvalidDataException("a message is too long");
                    } while (!part.EndOfMessage);
                    if (part.MessageType == WebSocketMessageType.Close) break;
                    Take((Fields)Json.Read(Encoding.UTF8.GetString(whole.ToArray())));
                }
                why = socket.CloseStatusDescription ?? why;
            }
            catch (Exception error) { why = "The connection to the gateway is closed (" + error.Message + ")."; }
            List<TaskCompletionSource<object>> left;
            lock (gate) left = waiting.Values.ToList();
            foreach (var one in left) one.TrySetException(new GoneException(why));
        }

        void Take(Fields message)
        {
            if (message.TryGetValue("ok", out var ok))
            {
                TaskCompletionSource<object> answer = null;
                lock (gate) if (message["id"] is long id) waiting.TryGetValue(id, out answer);
                if (true.Equals(ok)) answer?.TrySetResult(message.TryGetValue("body", out var body) ? body : null);
                else if (answer == null) Refused?.Invoke((string)message["error"]);
                else answer.TrySetException(new RefusedException((string)message["error"]));
            }
            else if (message.ContainsKey("seq"))
            {
                var state = new State(message);
                DropLifted(state);
                newest = state;
                StateCame?.Invoke(state);
            }
        }

        /// <summary>Forget the targets of fingers that were in a state and are in this one no more: ids are never used again.</summary>
        void DropLifted(State state)
        {
            var down = new HashSet<object>(state.Fingers.Select(finger => finger.All["id"]));
            lock (gate)
            {
                foreach (var key in held["targets"].Keys.Where(key => key is long).ToList())
                {
                    if (down.Contains(key)) seen.Add(key);
                    else if (seen.Remove(key)) held["targets"].Remove(key);
                }
            }
        }
    }

    /// <summary>JSON: objects are Fields, arrays List&lt;object&gt;, whole numbers long, others double; bytes are written as base64.</summary>
    public static class Json
    {
        const int Deepest = 32;

        public static double? Number(object value) => value is double d ? d : value is long n ? n : (double?)null;

        public static string Write(object value)
        {
            var text = new StringBuilder();
            Write(value, text);
            return text.ToString();
        }

        static void Write(object value, StringBuilder text)
        {
            if (value == null) text.Append("null");
            else if (value is bool) text.Append((bool)value ? "true" : "false");
            else if (value is string) WriteText((string)value, text);
            else if (value is byte[]) WriteText(Convert.ToBase64String((byte[])value), text);
            else if (value is double || value is float) text.Append(((IFormattable)value).ToString("R", CultureInfo.InvariantCulture));
            else if (value is IDictionary<string, object>)
            {
                text.Append('{');
                WriteAll((IDictionary<string, object>)value, text, one => { WriteText(one.Key, text); text.Append(':'); Write(one.Value, text); });
                text.Append('}');
            }
            else if (value is IEnumerable)
            {
                text.Append('[');
                WriteAll(((IEnumerable)value).Cast<object>(), text, one => Write(one, text));
                text.Append(']');
            }
            else text.Append(Convert.ToString(value, CultureInfo.InvariantCulture));
        }

        static void WriteAll<T>(IEnumerable<T> items, StringBuilder text, Action<T> write)
        {
            var isFirst = true;
            foreach (var one in items)
            {
                if (!isFirst) text.Append(',');
                isFirst = false;
                write(one);
            }
        }

        static void WriteText(string letters, StringBuilder text)
        {
            text.Append('"');
            foreach (var letter in letters)
            {
                if (letter == '"' || letter == '\\') text.Append('\\').Append(letter);
                else if (letter < ' ') text.Append("\\u").Append(((int)letter).ToString("x4"));
                else text.Append(letter);
            }
            text.Append('"');
        }

        /// <summary>Return the value of a text.</summary>
        /// <exception cref="FormatException">It is no JSON.</exception>
        public static object Read(string text)
        {
            var at = 0;
            var value = Read(text, ref at, 0);
            Skip(text, ref at);
            return at == text.Length ? value : throw new FormatException("more follows the JSON value");
        }

        static object Read(string text, ref int at, int depth)
        {
            Skip(text, ref at);
            if (at == text.Length || depth > Deepest) throw new FormatException("the JSON ends early, or is too deep");
            switch (text[at])
            {
                case '{': return ReadFields(text, ref at, depth);
                case '[': return ReadItems(text, ref at, depth);
                case '"': return ReadText(text, ref at);
                case 't': return Word(text, ref at, "true", true);
                case 'f': return Word(text, ref at, "false", false);
                case 'n': return Word(text, ref at, "null", null);
                default: return ReadNumber(text, ref at);
            }
        }

        static Fields ReadFields(string text, ref int at, int depth)
        {
            var fields = new Fields();
            for (at++; !Ends(text, ref at, '}', fields.Count);)
            {
                Skip(text, ref at);
                var name = ReadText(text, ref at);
                Expect(text, ref at, ':');
                fields[name] = Read(text, ref at, depth + 1);
            }
            return fields;
        }

        static List<object> ReadItems(string text, ref int at, int depth)
        {
            var items = new List<object>();
            for (at++; !Ends(text, ref at, ']', items.Count);) items.Add(Read(text, ref at, depth + 1));
            return items;
        }

        /// <summary>Whether a list ends here; else a comma is taken, but before its first item.</summary>
        static bool Ends(string text, ref int at, char end, int count)
        {
            Skip(text, ref at);
            if (at < text.Length && text[at] == end)
            {
                at++;
                return true;
            }
            if (count > 0) Expect(text, ref at, ',');
            return false;
        }

        static string ReadText(string text, ref int at)
        {
            Expect(text, ref at, '"');
            var letters = new StringBuilder();
            for (; at < text.Length && text[at] != '"'; at++)
            {
                if (text[at] != '\\') letters.Append(text[at]);
                else if (++at == text.Length) break;
                else if (text[at] == 'u' && at + 4 < text.Length)
                {
                    letters.Append((char)int.Parse(text.Substring(at + 1, 4), NumberStyles.AllowHexSpecifier, CultureInfo.InvariantCulture));
                    at += 4;
                }
                else
                {
                    var place = "bfnrt".IndexOf(text[at]);
                    letters.Append(place < 0 ? text[at] : "\b\f\n\r\t"[place]);
                }
            }
            Expect(text, ref at, '"');
            return letters.ToString();
        }

        static object ReadNumber(string text, ref int at)
        {
            var begin = at;
            while (at < text.Length && "+-.eE0123456789".IndexOf(text[at]) >= 0) at++;
            var digits = text.Substring(begin, at - begin);
            if (long.TryParse(digits, NumberStyles.AllowLeadingSign, CultureInfo.InvariantCulture, out var whole)) return whole;
            return double.Parse(digits, NumberStyles.Float, CultureInfo.InvariantCulture);
        }

        static object Word(string text, ref int at, string word, object value)
        {
            if (string.CompareOrdinal(text, at, word, 0, word.Length) != 0) throw new FormatException("no JSON value");
            at += word.Length;
            return value;
        }

        static void Skip(string text, ref int at)
        {
            while (at < text.Length && " \t\r\n".IndexOf(text[at]) >= 0) at++;
        }

        static void Expect(string text, ref int at, char letter)
        {
            Skip(text, ref at);
            if (at == text.Length || text[at] != letter) throw new FormatException("JSON misses " + letter);
            at++;
        }
    }
}
