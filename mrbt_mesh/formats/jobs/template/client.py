"""Hands work to the team that runs on this computer: `python client.py`, beside `mrbt up`."""

from datetime import timedelta

import anyio

from mrbt_mesh import connect


async def main() -> None:
    """Three jobs at once; an id makes it safe to run this again."""
    async with connect() as team:
        jobs = [
            await team.submit(
                "fetch", shelf, 2, job_id=f"morning-{shelf}", deadline=timedelta(minutes=5)
            )
            for shelf in ("A", "B", "C")
        ]
        for job in jobs:
            end = await job.done()
            print(f"{end.id}: {end.state}, by {', '.join(end.robots) or 'nobody'}")


anyio.run(main)
