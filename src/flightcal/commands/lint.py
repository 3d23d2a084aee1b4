"""`flightcal lint`: everything that is wrong, at once."""

import typer

from ..errors import USER_ERROR
from .options import ScenarioFile, TelemetryPlace


def lint(scenario: ScenarioFile, telemetry: TelemetryPlace = None) -> None:
    """List everything that is wrong with a scenario and its telemetry, each with its place.

    Example: `flightcal lint scenario.yaml`
    """
    from ..scenario import lint as findings_in
    from ..scenario import load_scenario

    findings = findings_in(scenario, telemetry=telemetry)
    for finding in findings:
        typer.echo(str(finding))
    if findings:
        typer.echo(f"{len(findings)} problem{'s' if len(findings) > 1 else ''} found", err=True)
        raise typer.Exit(USER_ERROR)
    from ..problem import build_window
    from ..telemetry import quality_table, read

    loaded = load_scenario(scenario, telemetry=telemetry)
    data = read(loaded)
    for window in loaded.windows:
        built = build_window(loaded, data, window)
        accuracy = built.network.accuracy if built.network is not None else None
        steps = "" if accuracy is None else f"; {accuracy.steps} steps, error {1e3 * accuracy.error:.2g} mK"
        typer.echo(f"window {window}: {len(built.times)} samples of {len(built.simulator.channels)} channels{steps}")
    for record in quality_table(data):
        typer.echo(f"telemetry {record.channel or 'file'}: {record.finding}, {record.samples} samples; {record.detail}")
    typer.echo(f"{scenario}: no problems found")
