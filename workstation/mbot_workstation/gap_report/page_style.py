"""The page's style sheet: for screens of any width, and for paper."""

STYLE = """
:root { --ink: #1c1c1e; --soft: #52525b; --line: #e4e4e7; --paper: #ffffff; --tint: #f7f7f8;
  --measured: #1c1c1e; --calibrated: #2f6fb2; --nominal: #d9772b;
  --fine: #2e7d4f; --borderline: #b7791f; --fails: #b3372f; --unknown: #71717a; }
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink); line-height: 1.5;
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, Arial, sans-serif; }
main { max-width: 1120px; margin: 0 auto; padding: 28px 20px 64px; }
h1 { font-size: 30px; line-height: 1.2; margin: 0 0 4px; letter-spacing: -0.01em; }
h2 { font-size: 21px; margin: 52px 0 6px; padding-top: 14px; border-top: 1px solid var(--line); }
h3 { font-size: 15px; margin: 0 0 2px; }
p { margin: 6px 0 12px; max-width: 74ch; }
.soft, .soft td { color: var(--soft); font-size: 14px; }
.lead { font-size: 19px; line-height: 1.45; margin: 20px 0 18px; max-width: 66ch; }
.lead b.after { color: var(--calibrated); } .lead b.before { color: var(--nominal); }
code { font: 13px/1.5 ui-monospace, SFMono-Regular, Menlo, Consolas, monospace;
  background: var(--tint); padding: 1px 5px; border-radius: 4px; overflow-wrap: anywhere; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(155px, 1fr)); gap: 10px; }
.tile { background: var(--tint); border-radius: 8px; padding: 12px 14px; }
.tile .name { font-size: 13px; color: var(--soft); }
.tile .value { font-size: 25px; font-weight: 650; line-height: 1.25; }
.tile .was { font-size: 13px; color: var(--soft); }
.tile.empty .value { color: var(--unknown); font-weight: 400; }
.charts { display: grid; gap: 22px 18px; margin-top: 14px;
  grid-template-columns: repeat(auto-fill, minmax(235px, 1fr)); }
.charts.wide { grid-template-columns: repeat(auto-fill, minmax(330px, 1fr)); }
.charts figure { margin: 0; }
figure svg, figure img { display: block; width: 100%; height: auto; }
figure img.small { image-rendering: pixelated; }
figcaption { font-size: 13px; color: var(--soft); margin-top: 4px; }
.key { display: flex; flex-wrap: wrap; gap: 4px 20px; font-size: 14px; color: var(--soft); }
.key i { display: inline-block; width: 22px; height: 0; border-top: 3px solid; margin-right: 7px;
  vertical-align: middle; }
.key .measured i { border-color: var(--measured); border-top-width: 2px; }
.key .calibrated i { border-color: var(--calibrated); }
.key .nominal i { border-color: var(--nominal); border-top-width: 2px; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; margin: 12px 0; font-size: 14px; width: auto;
  min-width: 60%;
  font-variant-numeric: tabular-nums; }
th { text-align: left; font-weight: 600; color: var(--soft); font-size: 13px; }
th, td { padding: 6px 14px 6px 0; border-bottom: 1px solid var(--line); vertical-align: top; }
td.number, th.number { text-align: right; white-space: nowrap; }
.verdict { display: grid; grid-template-columns: 190px 1fr 190px 190px; gap: 2px 18px;
  padding: 12px 0; border-bottom: 1px solid var(--line); align-items: center; }
.verdict.head { font-size: 13px; color: var(--soft); font-weight: 600; padding: 4px 0; }
.verdict .why { grid-column: 1 / -1; font-size: 13px; color: var(--soft); }
.verdict svg { width: 100%; height: 34px; display: block; overflow: visible; }
.verdict .label { display: none; font-size: 13px; color: var(--soft); }
.pill { display: inline-block; border-radius: 99px; padding: 1px 10px; font-size: 13px;
  font-weight: 600; color: #fff; white-space: nowrap; }
.pill.fine { background: var(--fine); } .pill.borderline { background: var(--borderline); }
.pill.fails { background: var(--fails); }
.pill.unknown { background: none; color: var(--unknown); border: 1px solid #d4d4d8;
  font-weight: 500; }
.amount { font-variant-numeric: tabular-nums; margin-right: 8px; }
.detail { font-size: 12.5px; color: var(--soft); }
.missing { border-left: 3px solid var(--borderline); background: #fdf8ee; padding: 10px 16px;
  border-radius: 0 8px 8px 0; margin: 18px 0; }
.missing ul { margin: 4px 0; padding-left: 18px; } .missing li { margin: 5px 0; }
.frames { display: grid; grid-template-columns: repeat(3, 1fr); gap: 6px 10px; margin: 14px 0; }
.frames figure { margin: 0; } .frames .title { grid-column: 1 / -1; }
footer { margin-top: 56px; padding-top: 12px; border-top: 1px solid var(--line);
  font-size: 13px; color: var(--soft); }
@media screen and (max-width: 760px) {
  main { padding: 18px 14px 48px; } h1 { font-size: 24px; } .lead { font-size: 17px; }
  .tiles { grid-template-columns: repeat(2, 1fr); }
  .verdict { grid-template-columns: 1fr 1fr; } .verdict.head { display: none; }
  .verdict h3, .verdict .bar { grid-column: 1 / -1; } .verdict .label { display: block; }
}
@media print {
  @page { size: A4; margin: 14mm; }
  body, p { font-size: 11px; } main { max-width: none; padding: 0; }
  h1 { font-size: 21px; } h2 { margin-top: 26px; font-size: 16px; } h3 { font-size: 11px; }
  .lead { font-size: 14px; } .soft, .key, table, th, code, figcaption { font-size: 10px; }
  .tiles { grid-template-columns: repeat(6, 1fr); gap: 6px; } .tile { padding: 7px 9px; }
  .tile .value { font-size: 16px; } .tile .name, .tile .was { font-size: 9px; }
  .verdict { grid-template-columns: 100px 1fr 150px 150px; padding: 6px 0; }
  .verdict .why, .verdict.head, .detail, .pill { font-size: 9.5px; }
  .charts { grid-template-columns: repeat(4, 1fr); gap: 10px; }
  .charts.wide { grid-template-columns: repeat(2, 1fr); }
  .tile, .missing, .pill { -webkit-print-color-adjust: exact; print-color-adjust: exact; }
  figure, .tile, .verdict, tr, .missing, .frames { break-inside: avoid; }
  h2, h3 { break-after: avoid; }
}
"""
