"""How a report looks: light and dark, on paper, and on a phone."""

_LIGHT = """
  --page: #f6f7f9; --panel: #fff; --ink: #1b2430; --soft: #56616f; --line: #dde2e8;
  --grid: #e8ecf0; --good: #19703a; --good-soft: #e2f3e7; --bad: #b3261e; --bad-soft: #fbe5e3;
  --warn: #855300; --warn-soft: #fbf0da; --mute: #eceff2; --bar: #3a78c9; --text-on: #10202f;
  --h0: #9cc4f5; --h1: #f6c48f; --h2: #a8dcb5; --h3: #d9b8f0; --h4: #f4b4bb; --h5: #99dcdc;
  --h6: #e8da85; --h7: #c6cedb;
""".strip()
_DARK = """
  --page: #0f141a; --panel: #171e27; --ink: #e4e9ef; --soft: #9caaba; --line: #2b3643;
  --grid: #232d39; --good: #68cd8a; --good-soft: #17352a; --bad: #ff8d84; --bad-soft: #45211f;
  --warn: #e8bb62; --warn-soft: #3b2f17; --mute: #242e3a; --bar: #6aa9ef; --text-on: #eef3f8;
  --h0: #27588f; --h1: #875317; --h2: #286a3f; --h3: #653f86; --h4: #86383f; --h5: #1f6768;
  --h6: #6f621a; --h7: #4a5666;
""".strip()
STYLE = (
    ":root { color-scheme: light dark;\n  "
    + _LIGHT
    + " }\n@media screen and (prefers-color-scheme: dark) { :root {\n  "
    + _DARK
    + """ } }
* { box-sizing: border-box; }
body { font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif;
  color: var(--ink); background: var(--page); margin: 0 auto; padding: 2rem 1.5rem 3rem;
  max-width: 78rem; }
h1 { font-size: 1.75rem; line-height: 1.2; margin: 0; overflow-wrap: anywhere; }
h2 { font-size: 1.1rem; margin: 0 0 .6rem; } h3 { font-size: .95rem; margin: 1.2rem 0 .3rem; }
p { margin: .35rem 0; } .soft { color: var(--soft); } ul { margin: .3rem 0; padding-left: 1.2rem; }
header.run { display: flex; flex-wrap: wrap; gap: .3rem 1rem; align-items: baseline;
  margin: 2.4rem 0 0; }
header.run:first-child { margin-top: 0; }
.chip { border-radius: 99px; padding: .1rem .8rem; font-weight: 650; background: var(--warn-soft);
  color: var(--warn); }
.chip.good { background: var(--good-soft); color: var(--good); }
.chip.bad { background: var(--bad-soft); color: var(--bad); }
.good { color: var(--good); } .bad { color: var(--bad); }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(10.5rem, 1fr)); gap: .7rem;
  margin: 1rem 0; }
.card, section { background: var(--panel); border: 1px solid var(--line); border-radius: .6rem; }
.card { padding: .7rem 1rem; }
.card b { display: block; font-size: 1.5rem; line-height: 1.25;
  font-variant-numeric: tabular-nums; }
.card i { font-style: normal; color: var(--soft); font-size: .86rem; }
section { padding: 1rem 1.2rem 1.1rem; margin: .8rem 0; }
.pair { display: grid; gap: 0 .8rem; grid-template-columns: minmax(0, 3fr) minmax(0, 2fr);
  align-items: start; }
.pair section { height: calc(100% - 1.6rem); }
.wide { overflow-x: auto; } .wide:focus-visible { outline: 2px solid var(--bar); }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .92rem; }
td, th { padding: .28rem 1.1rem .28rem 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid var(--line); }
tr:last-child td { border-bottom: 0; }
th { font-weight: 600; color: var(--soft); font-size: .84rem; white-space: nowrap; }
td { min-width: 3.4rem; } td.n { white-space: nowrap; } td.long, td.longest { min-width: 16rem; }
.meter { display: inline-block; vertical-align: middle; width: 7rem; height: .6rem;
  margin-right: .6rem;
  border-radius: 99px; background: var(--mute); overflow: hidden; }
.meter i { display: block; height: 100%; background: var(--bar); }
.legend { display: flex; flex-wrap: wrap; gap: .2rem 1.1rem; margin-top: .5rem; font-size: .84rem;
  color: var(--soft); }
.key { display: inline-block; width: .9rem; height: .7rem; border-radius: 2px;
  margin-right: .4rem; }
svg.gantt { display: block; width: 100%; min-width: 44rem; height: auto;
  font: 11px system-ui, "DejaVu Sans", sans-serif; }
.gantt .grid { stroke: var(--grid); } .gantt .lane { stroke: var(--line); stroke-width: .6; }
.gantt .tick { fill: var(--soft); }
.gantt .robot { fill: var(--ink); font-size: 13px; font-weight: 600; }
.gantt .on { fill: var(--text-on); } .gantt .end { text-anchor: end; font-weight: 700; }
.gantt .starting { fill: var(--warn); opacity: .65; }
.gantt .died, .gantt .failed { stroke: var(--bad); stroke-width: 1.4; }
.gantt .dropped { opacity: .55; }
.gantt .away { fill: var(--bad-soft); } .gantt .dead { fill: var(--bad); font-weight: 600; }
.gantt .death { stroke: var(--bad); stroke-width: 2.5; } .gantt .minor { fill: var(--warn); }
.gantt .detection { fill: var(--bad); } .gantt .takeover { fill: var(--good); }
.gantt .hand { fill: none; stroke: var(--good); stroke-width: 1.6; stroke-dasharray: 4 3; }
.gantt .head { fill: var(--good); }
"""
    + "\n".join(
        f".gantt .h{n} {{ fill: var(--h{n}); }} .key.h{n} {{ background: var(--h{n}); }}"
        for n in range(8)
    )
    + """
.key.starting { background: var(--warn); opacity: .65; } .key.away { background: var(--bad-soft);
  border: 1px solid var(--bad); } .key.takeover { background: var(--good); }
@media (max-width: 70rem) { .pair { grid-template-columns: minmax(0, 1fr); }
  .pair section { height: auto; } }
@media (max-width: 40rem) { body { padding: 1.2rem .8rem 2rem; font-size: 14px; }
  section { padding: .8rem .8rem .9rem; } .cards { grid-template-columns: repeat(2, 1fr); }
  .card b { font-size: 1.2rem; } td.long { min-width: 11rem; }
  td.longest { min-width: 21rem; } }
@media print { body { max-width: none; padding: 0; font-size: 11px; background: none; }
  section, .card { break-inside: avoid; border-color: #ccc; } .wide { overflow: visible; }
  svg.gantt { min-width: 0; } td.long, td.longest { min-width: 8rem; }
  td, th { padding-right: .6rem; }
  h1 { font-size: 1.4rem; } * { print-color-adjust: exact; -webkit-print-color-adjust: exact; } }
@page { size: A4 landscape; margin: 12mm; }
"""
)
