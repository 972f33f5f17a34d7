"""CacheService of the fake server."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import grpc
from fogbank._generated.v1 import cache_pb2, cache_pb2_grpc

from tests.clients.fake_caches import CACHE, FakeCaches, chunks, file_of, records_of
from tests.clients.fake_job import fail


class FakeCacheService(cache_pb2_grpc.CacheServiceServicer):
    """What it answers is up to its FakeCaches."""

    def __init__(self, caches: FakeCaches, blobs: Mapping[str, bytes]) -> None:
        """`blobs` are the uploads by SHA-256."""
        self._caches = caches
        self._blobs = blobs

    def GetCache(  # noqa: N802
        self, request: cache_pb2.GetCacheRequest, context: grpc.ServicerContext
    ) -> cache_pb2.GetCacheResponse:
        """As in the contract."""
        self._check_cache(request.name, context)
        return cache_pb2.GetCacheResponse(cache=self._caches.message())

    def ListCaches(  # noqa: N802
        self, request: cache_pb2.ListCachesRequest, context: grpc.ServicerContext
    ) -> cache_pb2.ListCachesResponse:
        """The one cache, on a second page."""
        if not request.page_token:
            return cache_pb2.ListCachesResponse(next_page_token="more")
        return cache_pb2.ListCachesResponse(caches=[self._caches.message(components=False)])

    def FillCache(  # noqa: N802
        self, request: cache_pb2.FillCacheRequest, context: grpc.ServicerContext
    ) -> Iterator[cache_pb2.FillCacheResponse]:
        """As in the contract; breaks off as it is told."""
        yield from self._caches.fill(request, context)

    def ViewCache(  # noqa: N802
        self, request: cache_pb2.ViewCacheRequest, context: grpc.ServicerContext
    ) -> Iterator[cache_pb2.ViewCacheResponse]:
        """As in the contract."""
        self._caches.view_requests.append(request)
        yield from self._caches.view()

    def ExportCache(  # noqa: N802
        self, request: cache_pb2.ExportCacheRequest, context: grpc.ServicerContext
    ) -> Iterator[cache_pb2.ExportCacheResponse]:
        """As in the contract; breaks off as it is told."""
        self._check_cache(request.name, context)
        left = self._caches.cut_exports_after.pop(0) if self._caches.cut_exports_after else None
        for number, chunk in enumerate(chunks(self._caches.export(), request.offset)):
            if left == number:
                context.abort(grpc.StatusCode.UNAVAILABLE, "connection lost")
            yield cache_pb2.ExportCacheResponse(chunk=chunk)

    def ImportCache(  # noqa: N802
        self, request: cache_pb2.ImportCacheRequest, context: grpc.ServicerContext
    ) -> cache_pb2.ImportCacheResponse:
        """As in the contract."""
        records = records_of(self._blobs[request.sha256])
        if records is None:
            fail(context, 3, "INVALID_CACHE_FILE", "not a cache file")
        new = len(records - self._caches.records)
        self._caches.records |= records
        return cache_pb2.ImportCacheResponse(cache=self._caches.message(), records_new=new)

    def MergeCaches(  # noqa: N802
        self, request: cache_pb2.MergeCachesRequest, context: grpc.ServicerContext
    ) -> Iterator[cache_pb2.MergeCachesResponse]:
        """As in the contract."""
        merged: set[str] = set()
        for sha256 in request.sha256s:
            merged |= records_of(self._blobs[sha256]) or set()
        for chunk in chunks(file_of(merged), request.offset):
            yield cache_pb2.MergeCachesResponse(chunk=chunk)

    def VerifyCache(  # noqa: N802
        self, request: cache_pb2.VerifyCacheRequest, context: grpc.ServicerContext
    ) -> cache_pb2.VerifyCacheResponse:
        """Everything is in order."""
        self._check_cache(request.name, context)
        return cache_pb2.VerifyCacheResponse(records=len(self._caches.records), segments=1, bytes=1000)

    def CollectCacheGarbage(  # noqa: N802
        self, request: cache_pb2.CollectCacheGarbageRequest, context: grpc.ServicerContext
    ) -> cache_pb2.CollectCacheGarbageResponse:
        """Removes the cache if it is above the budget."""
        if not request.HasField("budget_bytes") or request.budget_bytes >= 1000:
            return cache_pb2.CollectCacheGarbageResponse(bytes_before=1000, bytes_after=1000)
        self._caches.records.clear()
        return cache_pb2.CollectCacheGarbageResponse(removed=[CACHE], bytes_before=1000)

    def DeleteCache(  # noqa: N802
        self, request: cache_pb2.DeleteCacheRequest, context: grpc.ServicerContext
    ) -> cache_pb2.DeleteCacheResponse:
        """As in the contract."""
        self._check_cache(request.name, context)
        self._caches.records.clear()
        return cache_pb2.DeleteCacheResponse()

    def _check_cache(self, name: str, context: grpc.ServicerContext) -> None:
        if name != CACHE or not self._caches.records:
            fail(context, 5, "CACHE_NOT_FOUND", f"there is no {name}")
