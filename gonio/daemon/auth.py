"""TCP needs a token: whoever has an account on the machine can reach a loopback port."""

import hmac
from typing import Any
from urllib.parse import parse_qs

REFUSAL = b'{"detail":"the token is missing or wrong; it is in the address that the daemon printed","code":2}'


class TokenOnly:
    """ASGI: answers 401 to everything that does not bring the token, as `Authorization: Bearer` or `?token=`."""

    def __init__(self, app: Any, token: str):
        self._app, self._token = app, token.encode()

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "lifespan" or self._allowed(scope):
            await self._app(scope, receive, send)
            return
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
            return
        headers = [(b"content-type", b"application/json"), (b"www-authenticate", b"Bearer")]
        await send({"type": "http.response.start", "status": 401, "headers": headers})
        await send({"type": "http.response.body", "body": REFUSAL})

    def _allowed(self, scope: Any) -> bool:
        headers = dict(scope.get("headers", ()))
        given = headers.get(b"authorization", b"")
        if given.startswith(b"Bearer "):
            return hmac.compare_digest(given[7:], self._token)
        try:
            query = parse_qs(scope.get("query_string", b"").decode("ascii"))
        except (UnicodeDecodeError, ValueError):
            return False
        return hmac.compare_digest(query.get("token", [""])[0].encode("utf-8", "replace"), self._token)
